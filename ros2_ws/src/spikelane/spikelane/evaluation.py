"""Evaluating a controller: laps of every lane with several seeds, and how they went on the whole.

Each lap is the one that `spikelane lap` drives with the same lane and seed. Laps that are done are
kept one by one, so that an evaluation that was stopped goes on with the next, and its results are
those of one that never was: nothing in `metrics.json` depends on when or where it was made.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
import dataclasses
from pathlib import Path
import shutil
from typing import Any, NamedTuple

from spikelane import lap
from spikelane.configuration import Configuration
from spikelane.lap import drive, LapConfig, OnLapProgress
from spikelane.metrics import lap_metrics
from spikelane.run_folder import RunFolder
from spikelane.statistics import METHOD, share_statistics
from spikelane.summary import check_lap, summarise, summarise_by_lane, SummarisedLap
from spikelane.trajectory import read_csv, Trajectory, write_csv
from spikelane_controllers.operations import Operations, operations_metrics, sum_operations
from spikelane_sim.contract import STEP_S
from spikelane_sim.course import course_label, load_course, scenario_course
from spikelane_sim.files import write_json
from spikelane_sim.parameters import parameter, Parameters
from spikelane_sim.random_course import expand_courses


class LapRow(SummarisedLap):
    """What is used of the metrics of an evaluation's lap."""

    steps: int
    operations: Operations | None


#: Shows how an evaluation goes on: steps driven, share of it that is done.
ShowShare = Callable[[int, float], None]


@dataclasses.dataclass(frozen=True, kw_only=True)
class EvaluationParameters(Parameters):
    """What is driven."""

    seeds: int = parameter(1, 'Seeds, counted on from the first.', low=1, high=1_000_000)
    lanes: tuple[str, ...] = parameter((), 'Lanes driven; none: every lane of a course.')
    courses: tuple[str, ...] = parameter(
        (),
        "Courses driven; none: the scenario's. random:N: N random ones, of seeds 0 to N - 1; "
        'random:FIRST-LAST: those of these seeds.',
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
        """As in `run_folder.Run`."""
        return f'evaluate-{course_label(self.scenario)}-{self.controller}-seed{self.seed}'

    def laps(self) -> Iterator[LapOfEvaluation]:
        """Yield all laps, seed by seed within a lane, lane by lane within a course.

        A lap counts once, however often its course or lane is named.

        Raises:
            SpikelaneError: There is no such course, or no such lane on it.
        """
        given = [each for name in self.evaluation.courses for each in expand_courses(name)]
        courses = list(dict.fromkeys(given)) or [self.scenario]
        for number, scenario in enumerate(courses, 1):
            course = load_course(scenario_course(scenario))
            prefix = f'{number:03}-{course_label(scenario)}-' if len(courses) > 1 else ''
            simulator = dataclasses.replace(self.simulator, course=scenario_course(scenario))
            for lane in dict.fromkeys(self.evaluation.lanes or course.lanes):
                for seed in range(self.seed, self.seed + self.evaluation.seeds):
                    config = LapConfig(
                        scenario=scenario,
                        controller=self.controller,
                        lane=course.lane(lane).name,
                        seed=seed,
                        transport=self.transport,
                        simulator=simulator,
                        controller_parameters=self.controller_parameters,
                    )
                    length_m = course.lane(lane).length_m
                    yield LapOfEvaluation(f'{prefix}{lane}-seed{seed}', config, length_m)


class LapOfEvaluation(NamedTuple):
    """One of an evaluation's laps, or several laps in a row."""

    name: str  # of its folder
    config: LapConfig
    length_m: float  # of one lap


def make_config(
    scenario: str,
    controller: str,
    seed: int,
    transport: str,
    parameters: Mapping[str, Any],
    evaluation: Mapping[str, Any],
) -> EvaluateConfig:
    """Make the configuration of an evaluation.

    Args:
        scenario: As in `configure`; what the controller is for.
        controller: As in `configure`.
        seed: The first one.
        transport: As in `configure`.
        parameters: As in `lap.make_config`.
        evaluation: Parameters of `EvaluationParameters`, by name.

    Raises:
        SpikelaneError: Anything is unknown or not allowed.
    """
    one = lap.make_config(scenario, controller, None, seed, transport, parameters)
    parts = {field.name: getattr(one, field.name) for field in dataclasses.fields(Configuration)}
    given = EvaluationParameters.from_mapping(evaluation, 'evaluation')
    config = EvaluateConfig(evaluation=given, **parts)
    # This also finds out what cannot be driven before anything is.
    length_m = max(each.length_m for each in config.laps())
    limited = lap.limit_drive(config.simulator, parameters, length_m)
    return dataclasses.replace(config, simulator=limited)


def evaluate(config: EvaluateConfig, folder: RunFolder, show: ShowShare) -> dict[str, Any]:
    """Drive the laps that are not in the folder yet, and write the metrics of all.

    Args:
        config: What to drive.
        folder: Where laps and metrics go.
        show: Called after every step, over ROS about once a second.

    Returns:
        The metrics, ready for JSON.

    Raises:
        SpikelaneError: A lap cannot be driven, or a file not be written.
    """
    laps = list(config.laps())
    rows: list[dict[str, Any]] = []
    steps = 0
    for number, each in enumerate(laps):
        expected_m = each.length_m * max(1, config.simulator.episode.max_laps)

        def show_lap(
            step: int,
            progress_m: float,
            done: int = number,
            steps: int = steps,
            expected_m: float = expected_m,
        ) -> None:
            share = min(max(progress_m / expected_m, 0.0), 1.0)
            show(steps + step, (done + share) / len(laps))

        rows.append(_row_of(each, folder.laps / each.name, show_lap))
        steps += rows[-1]['steps']
        show(steps, (number + 1) / len(laps))
    metrics = evaluation_metrics(config, rows)
    folder.write_metrics(metrics)
    return metrics


def draw_some_courses(
    config: EvaluateConfig, folder: RunFolder, metrics: Mapping[str, Any]
) -> Path:
    """Draw the first courses of an evaluation, on each the laps of the first seed.

    Args:
        config: What was driven.
        folder: Where its laps are, and the figure goes.
        metrics: What `evaluate` returned.

    Returns:
        The figure.

    Raises:
        SpikelaneError: A lap cannot be read, or the figure not be written.
    """
    from spikelane.figures.courses import draw_courses, DrivenCourse, MOST

    drives: dict[str, list[tuple[Trajectory, Mapping[str, Any]]]] = {}
    for each, row in zip(config.laps(), metrics['laps'], strict=True):
        course = each.config.scenario
        if each.config.seed == config.seed and (course in drives or len(drives) < MOST):
            trajectory = read_csv(RunFolder(folder.laps / each.name).trajectory)
            drives.setdefault(course, []).append((trajectory, row))
    driven = [
        DrivenCourse(course_label(name), load_course(scenario_course(name)), found)
        for name, found in drives.items()
    ]
    completed = metrics['summary']['courses_completed']
    title = f'{config.controller}, {len(driven)} of {completed["n"]} courses'
    result = f'all laps completed on {completed["successes"]} of {completed["n"]}'
    figure, *_ = draw_courses(driven, folder.figures / 'courses', title, result)
    return figure


def evaluation_metrics(config: EvaluateConfig, rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Measure an evaluation.

    Args:
        config: What was driven.
        rows: One row for each lap: its course, lane and seed, what `lap_metrics` says,
            progress_m, and operations, the fields of `Operations` or None.

    Returns:
        Facts of the configuration; `operations`: what the network had to compute, as
        `operations_metrics` has it, None where it was not counted; `confidence`: how intervals
        are found; `summary`: of `all` laps, `by_lane` and, where there are several, `by_course`,
        as `summary.summarise` has it (the weights are those of one training, so that the unit is
        the course, or the seed where there is one course); then also `courses_completed`: on how
        many courses all laps were; `laps`: the rows.
    """
    courses = list(dict.fromkeys(row['course'] for row in rows))
    summary = summarise_by_lane(rows)
    if len(courses) > 1:
        summary['by_course'] = {
            course: summarise([row for row in rows if row['course'] == course])
            for course in courses
        }
        completed = [group['completed'] for group in summary['by_course'].values()]
        summary['courses_completed'] = share_statistics(
            sum(each['successes'] == each['n'] for each in completed), len(completed)
        )
    simulator = config.simulator
    return {
        'scenario': config.scenario,
        'controller': config.controller,
        'seed': config.seed,
        'seeds': config.evaluation.seeds,
        'transport': config.transport,
        'robot': simulator.robot.model,
        'engine': simulator.robot.engine,
        'pixels': simulator.pixels.model,
        'antialias': simulator.camera.antialias,
        'latency_ms': simulator.link.latency_ms,
        'event_loss': simulator.link.event_loss,
        'confidence': METHOD,
        'operations': _operations(rows),
        'summary': summary,
        'laps': list(rows),
    }


def _operations(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """Describe what the network had to compute in all laps, None where one's is not known."""
    counted = [Operations(**row['operations']) for row in rows if row.get('operations')]
    if len(counted) < len(rows):
        return None
    # Every observation counts, the one at the reset included.
    observations = sum(row['steps'] + 1 for row in rows)
    return operations_metrics(sum_operations(counted), observations * STEP_S)


def _row_of(each: LapOfEvaluation, path: Path, show: OnLapProgress) -> dict[str, Any]:
    """Drive a lap, or read what is left of it."""
    folder = RunFolder(path)
    if folder.metrics.exists():
        return folder.read_metrics(LapRow, check_lap)
    # What was being driven when somebody stopped it begins anew.
    shutil.rmtree(path, ignore_errors=True)
    RunFolder.create(path, numbered=False)
    driven = drive(each.config, folder, show)
    trajectory = driven.trajectory
    write_csv(trajectory, folder.trajectory)
    row = {
        'course': each.config.scenario,
        'lane': each.config.lane,
        'seed': each.config.seed,
        **lap_metrics(trajectory, STEP_S),
        'progress_m': float(trajectory.progress_m[-1] - trajectory.progress_m[0]),
        'operations': None if driven.operations is None else driven.operations._asdict(),
    }
    write_json(folder.metrics, row)
    return row
