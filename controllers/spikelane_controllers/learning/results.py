"""What a finished training, or another run that learns, has to show: numbers and figures.

The classes read what a run left in its folder, so that a run that has just ended and a report
made a year later show the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import math
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Protocol

from spikelane_controllers.checkpoint import Arrays, read_checkpoint
from spikelane_controllers.learning.settling import has_settled, last_lane_loss_step
from spikelane_controllers.learning.training import Termination
from spikelane_controllers.saved_state import number, records
from spikelane_sim.contract import (
    TERMINATED_LANE_LOST,
    TERMINATED_LAPS_COMPLETE,
    TERMINATED_STEP_LIMIT,
)
from spikelane_sim.course import Course, load_course, scenario_course
from spikelane_sim.errors import SpikelaneError

#: The measure that every training has.
LAST_LANE_LOSS = 'last_lane_loss_step'

#: Full episodes in a row from which on driving counts as stable.
IN_A_ROW = 3


class NothingToDrawError(SpikelaneError):
    """The run has nothing that this figure could show."""

    exit_status = 1


class Figure(NamedTuple):
    """A figure that can be drawn.

    Attributes:
        heading: Title of the report's part that it belongs to.
        name: Name of its files, without a folder.
        caption: What it shows.
        draw: Draws it. It takes the path of the file without ending and a title, and returns the
            files; it raises NothingToDrawError where there is nothing to be shown.
    """

    heading: str
    name: str
    caption: str
    draw: Callable[[Path, str], tuple[Path, ...]]


class Measure(NamedTuple):
    """A number that reports compare over runs, and with the paper's.

    Attributes:
        name: Its name in the metrics; `card.PaperValue` refers to it.
        words: What it is.
        unit: 'count', 'share', 'correlation', 'm' or 'spikes/ms'.
        value: The number. Of an event that had not come when the run ended: the time at the end.
        reached: Whether the event came; None where the measure is no time of an event.
    """

    name: str
    words: str
    unit: str
    value: float
    reached: bool | None = None


class Time(NamedTuple):
    """When a training got somewhere.

    Attributes:
        step: When it did, or was last observed without [steps of 50 ms].
        reached: Whether it did.
    """

    step: float
    reached: bool


class FinishedRun(NamedTuple):
    """What a run left.

    Attributes:
        controller: Name of the controller.
        folder: Folder of the run, with its checkpoint.
        config: What determined it, as in `config.yaml`.
        metrics: What it measured, as in `metrics.json`; empty where that is not known.
    """

    controller: str
    folder: Path
    config: Mapping[str, Any]
    metrics: Mapping[str, Any]


class Results(Protocol):
    """What every kind of run that learns has to show."""

    #: What one of its steps is, in words.
    step_words: ClassVar[str]
    #: What the measures mean, where a table shows them.
    note: ClassVar[str]

    def sort_key(self) -> float:
        """Return what runs are sorted by where the one in the middle stands for all."""

    def measures(self) -> tuple[Measure, ...]:
        """Return what reports compare."""

    def figures(self) -> tuple[Figure, ...]:
        """Return what can be drawn."""


class TrainingResults:
    """What a training has to show; classes of controllers that have more extend it.

    Attributes:
        run: What was read.
        steps: Steps driven, as the controller's training counts them.
        terminations: How each episode ended.
    """

    step_words: ClassVar[str] = '50 ms'

    def __init__(self, run: FinishedRun) -> None:
        """Read a training's checkpoint.

        Raises:
            CheckpointError: It cannot be read, or is not of a training of this controller.
        """
        self.run = run
        facts = read_checkpoint(run.folder, run.controller).facts
        self.steps = number(facts, 'steps', int)
        self.terminations = records(facts, 'terminations', Termination)
        self._read(facts)

    def _read(self, facts: Mapping[str, Any]) -> None:
        """Read what a controller's own training left in addition."""

    @property
    def last_lane_loss_step(self) -> int:
        """Step of the last episode that ended with the lane lost, 0 where none did."""
        return last_lane_loss_step(self.terminations)

    @property
    def has_settled(self) -> bool:
        """Whether every lane was lapped, or driven to the step limit, after that."""
        return has_settled(self.terminations)

    def metrics(self) -> dict[str, Any]:
        """Measure the training.

        Returns:
            Values by their names:

            - `steps`: Steps driven.
            - `episodes`: Episodes that ended.
            - `lane_losses`: Episodes that ended with the lane lost.
            - `last_lane_loss_step`: Step of the last of them, 0 where there was none.
            - `settled`: Whether every lane was driven in full after it
              (`settling.has_settled`); where not, it is only the last one so far.
            - `laps_since`: Laps completed after it, by lane.
        """
        last = self.last_lane_loss_step
        since = [
            each.lane
            for each in self.terminations
            if each.reason == TERMINATED_LAPS_COMPLETE and each.step > last
        ]
        return {
            'steps': self.steps,
            'episodes': len(self.terminations),
            'lane_losses': sum(e.reason == TERMINATED_LANE_LOST for e in self.terminations),
            'last_lane_loss_step': last,
            'settled': self.has_settled,
            'laps_since': {lane: since.count(lane) for lane in sorted(set(since))},
        }

    def episode_columns(self) -> list[dict[str, Any]]:
        """Return what is known of each episode in addition to its termination, by column."""
        return [{} for _ in self.terminations]

    def summary(self) -> dict[str, str]:
        """Return what a person wants to know first of how well it drives, by name."""
        laps = ', '.join(f'{n} {lane}' for lane, n in self.metrics()['laps_since'].items())
        return {'laps since': laps or 'none'}

    def sort_key(self) -> float:
        """Return the last lane loss; where a training has not settled, it is later than all."""
        return float(self.last_lane_loss_step) if self.has_settled else math.inf

    def measures(self) -> tuple[Measure, ...]:
        """Return what reports compare."""
        return (
            Measure(
                LAST_LANE_LOSS,
                'step of the last lane loss',
                'count',
                self.last_lane_loss_step,
                self.has_settled,
            ),
        )

    def first_lap(self) -> Time:
        """Return when the first lap was completed, or the training's end."""
        laps = (e.step for e in self.terminations if e.reason == TERMINATED_LAPS_COMPLETE)
        first = next(laps, None)
        return Time(self.steps if first is None else first, first is not None)

    def stable(self) -> Time:
        """Return when the first three episodes in a row began that were driven in full.

        All lanes are among them. One definition for all controllers, so that they compare; the
        end of the training where there were none.
        """
        index = first_stable(self.terminations)
        if index is None:
            return Time(self._driven_steps, False)
        return Time(sum(e.episode_steps for e in self.terminations[:index]), True)

    @property
    def _driven_steps(self) -> int:
        """Steps of 50 ms of the training."""
        return int(self.steps)

    def figures(self) -> tuple[Figure, ...]:
        """Return what can be drawn."""
        return (Figure(self._heading, 'terminations', 'Terminations', self._draw_terminations),)

    @property
    def _heading(self) -> str:
        from spikelane_controllers.registry import title

        return f'{title(self.run.controller)} training'

    def course(self) -> Course:
        """Return the course that was driven on."""
        return load_course(scenario_course(str(self.run.config['scenario'])))

    def arrays(self) -> Arrays:
        """Return the arrays of the checkpoint; they are not kept, since there are many runs."""
        return read_checkpoint(self.run.folder, self.run.controller).arrays

    def _draw_terminations(self, path: Path, title: str) -> tuple[Path, ...]:
        from spikelane_controllers.learning.terminations_figure import draw_terminations

        return draw_terminations(self, self.course(), path, title)


def first_stable(episodes: Sequence[Termination]) -> int | None:
    """Return the index of the first of three full episodes in a row, all lanes among them.

    A full episode ended with its laps, or at the step limit.
    """
    lanes = {each.lane for each in episodes}
    full = (TERMINATED_LAPS_COMPLETE, TERMINATED_STEP_LIMIT)
    for index in range(len(episodes) - IN_A_ROW + 1):
        run = episodes[index : index + IN_A_ROW]
        if all(each.reason in full for each in run) and {each.lane for each in run} == lanes:
            return index
    return None
