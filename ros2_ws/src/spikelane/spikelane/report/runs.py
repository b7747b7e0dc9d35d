"""What a report is made of: laps, trainings and transfers that have finished."""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

from spikelane_controllers.learning.results import Results, TrainingResults
from spikelane_sim.course import Course, load_course, scenario_course

#: Stands for the scenario of laps on one of many random courses.
RANDOM_COURSES = 'random courses'


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class ReportedRun:
    """What all runs have.

    Attributes:
        controller: Name in the controllers' registry.
        scenario: A scenario of the paper, '1' to '3', or a course file's name; RANDOM_COURSES for
            the laps of an evaluation on many of them.
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
class Lap(ReportedRun):
    """An episode driven without learning; `folder` has its trajectory.

    Attributes:
        lane: Its name.
        training: What its weights are of: the checkpoint it drove with, '' for the usual one.
            Laps of one training are not independent.
    """

    lane: str
    training: str = ''


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class TrainingRun(ReportedRun):
    """A training.

    Attributes:
        results: What it has to show.
    """

    results: TrainingResults


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class TransferRun(ReportedRun):
    """A transfer of what one controller has learnt to another one.

    Attributes:
        results: What it has to show.
    """

    results: Results


class Conditions(NamedTuple):
    """The results of an experiment with conditions, or with parameters that are swept."""

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
        trainings: Trainings of controllers.
        transfers: Transfers of policies.
        conditions: Results of experiments that have conditions.
        swept: Results of experiments that sweep parameters.
        left_out: What cannot be used.
        variants: What experiments call the settings of their runs, by the runs' folders.
        settings: What names stand for that runs have for a setting.
        listed: For each folder of an experiment, the folders of its runs by their names.
    """

    laps: list[Lap] = dataclasses.field(default_factory=list)
    trainings: list[TrainingRun] = dataclasses.field(default_factory=list)
    transfers: list[TransferRun] = dataclasses.field(default_factory=list)
    conditions: list[Conditions] = dataclasses.field(default_factory=list)
    swept: list[Conditions] = dataclasses.field(default_factory=list)
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


def course_of(run: ReportedRun) -> Course:
    """Return what was driven on."""
    return load_course(scenario_course(str(run.config['scenario'])))
