"""What a report takes from the files of runs: names, and kinds of values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypedDict

from spikelane_controllers.operations import Operations
from spikelane_sim.kinds import check_kind, Scalar
from spikelane_sim.simulator_parameters import current_config

#: A parameter, or a group of them.
_Setting = Scalar | list[Scalar] | dict[str, Scalar | list[Scalar]]

#: What a damaged file of one run can raise though its kinds were checked; the others go on.
UNUSABLE = (ArithmeticError, AttributeError, LookupError, OSError, TypeError, ValueError)


class _Determined(TypedDict):
    scenario: str | int
    seed: int


class _TrainingConfig(TypedDict, total=False):
    steps: int
    save_every: int


class _EvaluationConfig(TypedDict):
    seeds: int
    lanes: list[str]
    courses: list[str]


class _Config(_Determined, total=False):
    controller: str
    lane: str
    transport: str
    checkpoint: str
    from_training: bool
    training: _TrainingConfig
    evaluation: _EvaluationConfig
    simulator: dict[str, Any]
    gathering: dict[str, Any]
    given: dict[str, Any]
    command_line: list[str]
    transfer: dict[str, Any]


class _Lap(TypedDict):
    completed: bool
    steps: int
    mean_abs_distance_m: float
    max_abs_distance_m: float
    mean_distance_m: float
    lap_time_s: float | None


class LapMetrics(_Lap, total=False):
    """The metrics of a lap."""

    operations: Operations | None


class LapOfEvaluation(LapMetrics):
    """The metrics of a lap that an evaluation drove."""

    course: str
    lane: str
    seed: int


class _Course(TypedDict):
    course: str


class EvaluationMetrics(TypedDict):
    """The metrics of an evaluation; its laps have files of their own."""

    laps: list[_Course]


class _Listed(TypedDict):
    name: str
    state: str


class _Run(_Listed, total=False):
    message: str
    folder: str | None
    variants: str


class _Runs(TypedDict):
    runs: list[_Run]


class Results(_Runs, total=False):
    """The results of an experiment."""

    groups: list[dict[str, Any]]


class LearntFacts(TypedDict, total=False):
    """What a checkpoint says of how its weights were learnt."""

    config: dict[str, _Setting]
    steps: int | None


def check_config(config: Any) -> Mapping[str, Any]:
    """Check what determined a run, and return it under today's names.

    Raises:
        KindError: Something that determines every run is missing, or a value is of another kind.
    """
    check_kind(config, dict[str, _Setting])
    return current_config(check_kind(config, _Config))
