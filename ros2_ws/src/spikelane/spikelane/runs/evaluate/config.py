"""What determines an evaluation: which laps are driven."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import dataclasses
from typing import Any, NamedTuple

from spikelane.runs.configuration import Configuration, configure, Request
from spikelane.runs.lap.config import default_weights, LapConfig, limit_drive
from spikelane_sim.course import course_label, load_course, scenario_course
from spikelane_sim.parameters import parameter, Parameters
from spikelane_sim.random_course import expand_courses


@dataclasses.dataclass(frozen=True, kw_only=True)
class EvaluationParameters(Parameters):
    """What is driven."""

    seeds: int = parameter(
        1, 'Number of seeds that are driven, counted up from the first one.', low=1, high=1_000_000
    )
    lanes: tuple[str, ...] = parameter((), 'Lanes to drive; none: every lane of a course.')
    courses: tuple[str, ...] = parameter(
        (),
        'Courses to drive; none: the course of the scenario. random:N: N random courses with '
        'seeds 0 to N - 1; random:FIRST-LAST: the random courses with these seeds.',
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class EvaluateConfig(Configuration):
    """Everything that determines an evaluation.

    Attributes:
        evaluation: What is driven; `seed` is the first seed.
    """

    evaluation: EvaluationParameters

    @property
    def usual_name(self) -> str:
        """As in RunConfig."""
        return f'evaluate-{course_label(self.scenario)}-{self.controller}-seed{self.seed}'

    def laps(self) -> Iterator[LapOfEvaluation]:
        """Yield all laps, seed by seed within a lane, lane by lane within a course.

        A lap counts once, however often its course or lane is named.

        Raises:
            SpikelaneError: There is no such course, or no such lane on it.
        """
        given = [each for name in self.evaluation.courses for each in expand_courses(name)]
        courses = list(dict.fromkeys(given)) or [self.scenario]
        parts = {each.name: getattr(self, each.name) for each in dataclasses.fields(Configuration)}
        for number, scenario in enumerate(courses, 1):
            course = load_course(scenario_course(scenario))
            prefix = f'{number:03}-{course_label(scenario)}-' if len(courses) > 1 else ''
            simulator = dataclasses.replace(self.simulator, course=scenario_course(scenario))
            parts |= {'scenario': scenario, 'simulator': simulator}
            for lane in dict.fromkeys(self.evaluation.lanes or course.lanes):
                for seed in range(self.seed, self.seed + self.evaluation.seeds):
                    config = LapConfig(lane=course.lane(lane).name, **{**parts, 'seed': seed})
                    length_m = course.lane(lane).length_m
                    yield LapOfEvaluation(f'{prefix}{lane}-seed{seed}', config, length_m)

    @classmethod
    def make(cls, asked: Request, evaluation: Mapping[str, Any]) -> EvaluateConfig:
        """Make the configuration of an evaluation.

        Args:
            asked: As for a lap (`LapConfig.make`); its scenario is what the controller is for, its
                seed the first one.
            evaluation: Parameters of `EvaluationParameters`, by name.

        Raises:
            SpikelaneError: Anything is unknown or not allowed.
        """
        parts = configure(asked, default_weights(asked.scenario, asked.controller))
        load_course(parts['simulator'].course)  # refuses one that is not there
        driven = EvaluationParameters.from_mapping(evaluation, 'evaluation')
        config = cls(evaluation=driven, **parts)
        # This also finds out what cannot be driven before anything is.
        length_m = max(each.length_m for each in config.laps())
        limited = limit_drive(config.simulator, asked.parameters, length_m)
        return dataclasses.replace(config, simulator=limited)


class LapOfEvaluation(NamedTuple):
    """One of an evaluation's laps, or several laps in a row."""

    name: str  # of its folder
    config: LapConfig
    length_m: float  # of one lap
