"""What came of an experiment: every run, and results over the seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import json
import math
from typing import Any, TypedDict

from spikelane.experiment.runner import Status
from spikelane.runs.evaluate.summary import check_lap, summarise_by_lane, SummarisedLap
from spikelane.runs.folder import RunFolder
from spikelane.statistics import mean_statistics, METHOD, time_statistics
from spikelane_sim.kinds import check_kind

#: Metrics that are no results of a run, or not comparable.
_NOT_MEASURED = ('seed', 'seeds', 'wall_time_s')

#: Metrics of trainings: steps at which something was reached, or was not by then.
_TIMES = ('last_lane_loss_step', 'solved_at', 'solved_by')

#: Numbers that are shares, and numbers that cannot be negative; of others that is not known.
_SHARES = ('accuracy', 'training_accuracy', 'event_loss')
_NOT_NEGATIVE = (
    'steps',
    'episodes',
    'lane_losses',
    'full_episodes',
    'updates',
    'states',
    'held_out_states',
    'maximum',
    'latency_ms',
)

RESULTS_FILE = 'results.json'


class _Driven(TypedDict):
    steps: int


class _TrainingMetrics(_Driven, total=False):
    last_lane_loss_step: int
    settled: bool
    solved_at: int | None
    solved_by: int | None


class _EvaluationMetrics(TypedDict, total=False):
    laps: list[SummarisedLap]
    operations: dict[str, float] | None


#: What is used of the metrics of a task's runs, in addition to numbers.
_METRICS = {'train': _TrainingMetrics, 'evaluate': _EvaluationMetrics}


def experiment_results(name: str, statuses: Sequence[Status]) -> dict[str, Any]:
    """Describe an experiment.

    Args:
        name: Name of the experiment.
        statuses: Statuses of its runs.

    Returns:
        name; `confidence`: how intervals are found; `runs`: of each its name, task, place in the
        matrix, state, message and folder; `groups`: of finished runs that differ in nothing but
        the seed, those before them included: their task and place, seeds, the parameters of
        their simulator, and `metrics`:
        statistics of each number over the seeds (`mean_statistics`), `operations` of evaluations
        likewise; `times` of trainings: those of `_TIMES`, censored where they were not reached
        (`time_statistics`); `laps` of evaluations (`summary.summarise_by_lane`), the same lap
        with the same weights once. Where each run drives with the weights of a training of its
        own, the trainings are the units.

    Raises:
        FileError: The metrics of a finished run cannot be read.
    """
    return {
        'name': name,
        'confidence': METHOD,
        'runs': [
            {
                'name': status.run.name,
                **_place(status),
                'seed': status.run.point.seed,
                'state': status.state.value,
                'message': status.message,
                'folder': None if status.folder is None else status.folder.path.name,
            }
            for status in statuses
        ],
        'groups': _groups([status for status in statuses if status.state.is_finished]),
    }


def _groups(statuses: Sequence[Status]) -> list[dict[str, Any]]:
    grouped: dict[str, list[Status]] = {}
    for status in statuses:
        grouped.setdefault(json.dumps(_seedless(status.run.identity)), []).append(status)
    return [_group(members) for members in grouped.values()]


def _group(members: Sequence[Status]) -> dict[str, Any]:
    kind = _METRICS.get(members[0].run.task, dict[str, Any])
    found = [
        status.folder.read_metrics(kind, _check_metrics)
        for status in members
        if status.folder is not None
    ]
    names = [name for name, value in found[0].items() if _is_measured(name, value)]
    configuration = members[0].run.identity['configuration']
    group = {
        **_place(members[0]),
        'seeds': [status.run.point.seed for status in members],
        'simulator': configuration.get('simulator', {}),
        **({'filter': configuration['filter']} if 'filter' in configuration else {}),
        'metrics': {
            name: mean_statistics([metrics[name] for metrics in found], None, *_bounds(name))
            for name in names
            if all(_is_measured(name, metrics.get(name)) for metrics in found)
        },
    }
    counted = [metrics['operations'] for metrics in found if metrics.get('operations')]
    if len(counted) == len(found):
        group['operations'] = {
            name: mean_statistics([operations[name] for operations in counted], low=0.0)
            for name in counted[0]
            if all(name in operations for operations in counted)
        }
    if times := {
        name: _times(name, found) for name in _TIMES if all(name in metrics for metrics in found)
    }:
        group['times'] = times
    if laps := _laps(members, found):
        group['laps'] = summarise_by_lane(laps)
    return group


def _check_metrics(metrics: Mapping[str, Any]) -> None:
    for name, value in metrics.items():
        if _is_measured(name, value):
            check_kind(value, float, name)
    for number, lap in enumerate(metrics.get('laps', ())):
        check_lap(lap, f'laps[{number}].')


def _bounds(name: str) -> tuple[float, float]:
    """Return the smallest and largest possible value of a number in metrics."""
    if name in _SHARES:
        return 0.0, 1.0
    return (0.0 if name in _NOT_NEGATIVE else -math.inf), math.inf


def _times(name: str, found: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """Describe when trainings reached something."""
    if name == 'last_lane_loss_step':
        # Metrics of a version that did not tell count as those of a training that has not settled.
        reached = [bool(metrics.get('settled')) for metrics in found]
        return time_statistics([metrics[name] for metrics in found], reached)
    reached = [metrics[name] is not None for metrics in found]
    times = [
        metrics[name] if is_reached else metrics['steps']
        for metrics, is_reached in zip(found, reached, strict=True)
    ]
    return time_statistics(times, reached)


def _laps(members: Sequence[Status], found: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the laps of evaluations; where nothing is learnt seeds of several can overlap."""
    laps = {
        (status.run.before, lap['course'], lap['lane'], lap['seed']): {
            **lap,
            'training': status.run.before,
        }
        for status, metrics in zip(members, found, strict=True)
        for lap in metrics.get('laps', ())
    }
    return list(laps.values())


def _seedless(identity: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a run is but for its seed and that of the run before it."""
    before = identity['before']
    configuration = {k: v for k, v in identity['configuration'].items() if k != 'seed'}
    return {
        **identity,
        'configuration': configuration,
        'before': None if before is None else _seedless(before),
    }


def _place(status: Status) -> dict[str, Any]:
    point = status.run.point
    return {
        'task': status.run.task,
        'controller': point.controller,
        'scenario': point.scenario,
        **status.run.labels,
    }


def _is_measured(name: str, value: object) -> bool:
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    is_other = name in _NOT_MEASURED or name in _TIMES
    return is_number and not is_other


def write_results(folder: RunFolder, results: Mapping[str, Any]) -> None:
    """Write an experiment's results into its folder.

    Raises:
        FileError: They cannot be written.
    """
    folder.write_json(RESULTS_FILE, results)
