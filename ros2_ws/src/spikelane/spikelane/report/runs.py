"""What a report is made of: laps, trainings and transfers that have finished."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

from spikelane.dqn_results import first_solved
from spikelane.settling import has_settled, last_lane_loss_step
from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_controllers.convergence import RateError
from spikelane_controllers.dqn_training import Outcome
from spikelane_controllers.state import records
from spikelane_controllers.training import Termination
from spikelane_controllers.transfer import Measured
from spikelane_sim.course import Course, load_course, scenario_course

#: Stands for the scenario of laps on one of many random courses.
RANDOM_COURSES = 'random courses'


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class Run:
    """What all runs have.

    Attributes:
        controller: Name in the controllers' registry.
        scenario: '1' to '3' of the paper, or a course file's name; RANDOM_COURSES of laps of an
            evaluation on many of them.
        seed: Seed of the run.
        setting: How its parameters differ from the paper's, in words, or what that is named;
            '' where they do not.
        folder: Where it is.
        config: What determined it.
        metrics: What came out.
        learnt_steps: Steps of the training that it is, or that its weights are of; None where
            there is none or it is not known.
    """

    controller: str
    scenario: str
    seed: int
    setting: str
    folder: Path
    config: Mapping[str, Any]
    metrics: Mapping[str, Any]
    learnt_steps: int | None = None


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class Lap(Run):
    """An episode driven without learning; `folder` has its trajectory.

    Attributes:
        lane: Its name.
        training: What its weights are of: the checkpoint it drove with, '' for the usual one.
            Laps of one training are not independent.
    """

    lane: str
    training: str = ''


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class TrainingRun(Run):
    """A training.

    Attributes:
        steps: Driven, as the controller's training counts them.
        terminations: Terminations of its episodes.
        outcomes: Outcomes of its episodes; for a deep Q-network alone.
    """

    steps: int
    terminations: Sequence[Termination]
    outcomes: Sequence[Outcome]

    @property
    def last_lane_loss_step(self) -> int:
        """Step of the last episode that ended with the lane lost, 0 where none did."""
        return last_lane_loss_step(self.terminations)

    @property
    def has_settled(self) -> bool:
        """Whether every lane was lapped, or driven to the step limit, after that."""
        return has_settled(self.terminations)

    @property
    def solved_episode(self) -> int | None:
        """Number of the first of three episodes in a row, on both lanes, of full length."""
        index = first_solved(list(self.terminations))
        return None if index is None else index + 1

    @property
    def solved_step(self) -> int | None:
        """Step by which these three episodes have ended, as the controller's training counts."""
        first = self.solved_episode
        return None if first is None else self.terminations[first + 1].step


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class TransferRun(Run):
    """The transfer of a policy to a spiking network."""

    @property
    def curve(self) -> list[Measured]:
        """Accuracy over the training."""
        facts = read_checkpoint(self.folder, self.controller).facts
        return records(facts, 'curve', Measured)

    @property
    def rates(self) -> dict[str, list[RateError]]:
        """Differences of rates from activations, by how neurons are reset."""
        return {
            name: [RateError(**each) for each in errors]
            for name, errors in self.metrics['rates'].items()
        }


class Conditions(NamedTuple):
    """The results of an experiment with conditions."""

    folder: Path
    results: Mapping[str, Any]


class LeftOut(NamedTuple):
    """What is not in the report."""

    what: str
    why: str


class NamedSetting(NamedTuple):
    """What a setting's name stands for.

    Attributes:
        controller: Name in the controllers' registry.
        kind: Kind of the runs that have it, in words.
        name: Theirs for it.
        words: How its parameters differ from the paper's.
    """

    controller: str
    kind: str
    name: str
    words: str


@dataclasses.dataclass(frozen=True)
class Runs:
    """All that was found.

    Attributes:
        laps: Driven without learning.
        trainings: Trainings of controllers that learn.
        transfers: Transfers of policies.
        conditions: Conditions of experiments that have them.
        left_out: What cannot be used.
        variants: What experiments call the settings of their runs, by the runs' folders.
        settings: What names stand for that runs have for a setting.
        listed: For each experiment's folder: names of the folders of runs, by the runs'.
    """

    laps: list[Lap] = dataclasses.field(default_factory=list)
    trainings: list[TrainingRun] = dataclasses.field(default_factory=list)
    transfers: list[TransferRun] = dataclasses.field(default_factory=list)
    conditions: list[Conditions] = dataclasses.field(default_factory=list)
    left_out: list[LeftOut] = dataclasses.field(default_factory=list)
    settings: list[NamedSetting] = dataclasses.field(default_factory=list)
    variants: dict[Path, str] = dataclasses.field(default_factory=dict)
    listed: dict[Path, dict[str, str]] = dataclasses.field(default_factory=dict)

    def __len__(self) -> int:
        """Return the number of runs that can be used."""
        return len(self.all())

    def all(self) -> list[Lap | TrainingRun | TransferRun]:
        """Return every run that can be used."""
        return [*self.trainings, *self.transfers, *self.laps]


def course_of(run: Lap | TrainingRun) -> Course:
    """Return what was driven on."""
    return load_course(scenario_course(str(run.config['scenario'])))
