"""The report's tables of laps driven with learning off, over independent units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any

from spikelane.report.groups import by_key, Key, seeds_in_words, Table
from spikelane.report.quantities import COUNT, METRES, NOTHING, SIGNED_METRES
from spikelane.report.runs import Lap
from spikelane.runs.evaluate.summary import laps_by_unit, unit_of, UNITS
from spikelane.statistics import effective_units, share_statistics, unit_means
from spikelane_controllers.operations import Operations, operations_metrics, sum_operations
from spikelane_controllers.registry import cards, title
from spikelane_sim.period import PERIOD_MS
from spikelane_sim.simulator_parameters import period_ms_of

#: Parameter of the distance from the lane's centre at which an episode ends.
_LIMIT = 'episode.max_distance_m'

#: Laps of a group by their unit, each with its course, lane, seed and metrics.
Units = dict[Any, list[dict[str, Any]]]


def units_of(laps: Sequence[Lap]) -> tuple[str, Units]:
    """Group the laps of a group of runs by what is independent (`summary`).

    Returns:
        What the unit is, one of `summary.UNITS`; the laps by it, of distinct units alone.
    """
    rows = [
        {
            **lap.metrics,
            'training': lap.training,
            'course': lap.config.get('scenario'),
            'lane': lap.lane,
            'seed': lap.seed,
        }
        for lap in laps
    ]
    unit = unit_of(rows)
    return unit, {name: list(map(dict, each)) for name, each in laps_by_unit(rows, unit).items()}


def lap_tables(laps: Sequence[Lap]) -> list[Table]:
    """Return the tables of laps."""
    return [_of_success(laps), _of_laps(laps), _of_kept(laps), _of_operations(laps)]


def _of_success(laps: Sequence[Lap]) -> Table:
    rows = [_row_of_success(key, group) for key, group in by_key(laps).items()]
    return Table(
        'Success with learning off',
        'A unit, which is a training where several were driven, is successful if every lap of it '
        'is completed, on every lane that it drove. In brackets: 95 % interval of the share '
        "(Wilson's). Laps of one unit are not independent, and repeats of the same drive count "
        'once.',
        ('controller', 'scenario', 'setting', 'unit', 'lanes', 'laps of each unit', 'successful')
        + ('seeds of laps',),
        rows,
        brief=('successful',),
    )


def _row_of_success(key: Key, laps: Sequence[Lap]) -> tuple[str, ...]:
    unit, units = units_of(laps)
    whole = sum(all(lap['completed'] for lap in each) for each in units.values())
    return (
        title(key.controller),
        key.scenario,
        key.shown_setting,
        unit,
        ', '.join(dict.fromkeys(lap.lane for lap in laps)),
        COUNT.median([len(each) for each in units.values()]),
        _share(whole, len(units), len(units)),
        seeds_in_words([lap.seed for lap in laps]),
    )


def _share(successes: int, n: int, units: float) -> str:
    share = share_statistics(successes, n, units)
    return f'{successes} of {n} ({share["ci_low"]:.0%} to {share["ci_high"]:.0%})'


def _of_laps(laps: Sequence[Lap]) -> Table:
    rows = []
    for key, group in by_key(laps).items():
        for lane in dict.fromkeys(lap.lane for lap in group):
            rows.append(_row_of_laps(key, lane, [lap for lap in group if lap.lane == lane]))
    return Table(
        'Laps',
        'Errors are of completed laps, averaged by unit. Mean deviation: right of the centre is '
        "positive. Completed: with the 95 % interval of the share (Wilson's, for as many draws as "
        'there are units). Units: distinct ones; seeds that gave the same drive are one.',
        ('controller', 'scenario', 'setting', 'lane', 'completed')
        + (
            'mean error ± s (95 %)',
            'median (range)',
            'mean deviation',
            'largest error',
            'steps of a lap',
            'units',
            'seeds of laps',
        ),
        rows,
        brief=('lane', 'completed', 'median (range)'),
    )


def _row_of_laps(key: Key, lane: str, laps: Sequence[Lap]) -> tuple[str, ...]:
    unit, units = units_of(laps)
    sizes = [len(each) for each in units.values()]
    done = [(name, lap) for name, each in units.items() for lap in each if lap['completed']]
    names = [name for name, _ in done]

    def values(name: str) -> list[float]:
        return [lap[name] for _, lap in done]

    return (
        title(key.controller),
        key.scenario,
        key.shown_setting,
        lane,
        _share(len(done), sum(sizes), effective_units(sizes)),
        METRES.mean(values('mean_abs_distance_m'), names),
        METRES.median(unit_means(values('mean_abs_distance_m'), names)),
        SIGNED_METRES.mean(values('mean_distance_m'), names),
        METRES.show(max(values('max_abs_distance_m'))) if done else NOTHING,
        COUNT.mean([lap_steps(lap) for _, lap in done], names),
        f'{len(units)} {unit if len(units) == 1 else UNITS[unit]}',
        seeds_in_words([lap.seed for lap in laps]),
    )


def _of_kept(laps: Sequence[Lap]) -> Table:
    rows = [
        _row_of_kept(key, limit_m, group)
        for key, group in by_key(laps).items()
        if (limit_m := _training_limit_m(key.controller)) < _limit_m(group[0])
    ]
    return Table(
        'Lanes kept with learning off',
        'A lap is kept if it is completed and the robot is never farther from the centre of its '
        'lane than the distance at which a training is reset. A unit is successful if all of its '
        "laps are kept. In brackets: 95 % interval of the share (Wilson's).",
        ('controller', 'scenario', 'setting', 'distance', 'laps kept', 'unit', 'successful'),
        rows,
        brief=('laps kept', 'successful'),
    )


def _training_limit_m(controller: str) -> float:
    """Return the distance at which trainings are reset [m], infinite for none."""
    found = cards().get(controller)
    defaults = found.training.defaults if found and found.training else {}
    return float(defaults.get(f'simulator.{_LIMIT}') or math.inf)


def _limit_m(lap: Lap) -> float:
    """Return the distance at which a lap ends [m], infinite for none; 0 where it is not known."""
    limit_m = lap.config.get('simulator', {}).get(_LIMIT)
    return 0.0 if limit_m is None else float(limit_m) or math.inf


def _row_of_kept(key: Key, limit_m: float, laps: Sequence[Lap]) -> tuple[str, ...]:
    unit, units = units_of(laps)
    kept = [
        [lap['completed'] and lap['max_abs_distance_m'] <= limit_m for lap in each]
        for each in units.values()
    ]
    return (
        title(key.controller),
        key.scenario,
        key.shown_setting,
        f'{limit_m:g} m',
        f'{sum(map(sum, kept))} of {sum(map(len, kept))}',
        unit,
        _share(sum(map(all, kept)), len(kept), len(kept)),
    )


def _of_operations(laps: Sequence[Lap]) -> Table:
    counted = by_key(lap for lap in laps if lap.metrics.get('operations'))
    rows = [_row_of_operations(key, group) for key, group in counted.items()]
    return Table(
        'Operations for a decision',
        'A stand-in for energy: a spike counts at each synapse that it reaches, a '
        'multiply-accumulate is a weight of a layer whose inputs are numbers; in brackets '
        'without those of inputs that are 0. Updates of neurons, biases and learning are not '
        'counted. Counted of laps driven in one process; those driven over ROS, and those of '
        'versions that did not count, are not among them.',
        ('controller', 'scenario', 'setting', 'decisions in a second')
        + ('synaptic operations for a decision', 'multiply-accumulates for a decision')
        + ('synaptic operations in a second', 'multiply-accumulates in a second', 'laps'),
        rows,
        brief=('synaptic operations in a second', 'multiply-accumulates in a second'),
    )


def _row_of_operations(key: Key, laps: Sequence[Lap]) -> tuple[str, ...]:
    total = sum_operations(Operations(**lap.metrics['operations']) for lap in laps)
    # Every observation counts, the one at the reset included.
    time_s = sum((lap.metrics['steps'] + 1) * period_ms_of(lap.config) for lap in laps) / 1000
    found = operations_metrics(total, time_s)

    def cells(per: str) -> tuple[str, str]:
        synaptic = found.get(f'synaptic_operations_{per}')
        all_, active = (found.get(f'{name}multiply_accumulates_{per}') for name in ('', 'active_'))
        in_brackets = '' if active is None else f' ({COUNT.show(active)})'
        return (
            NOTHING if synaptic is None else COUNT.show(synaptic),
            NOTHING if all_ is None else f'{COUNT.show(all_)}{in_brackets}',
        )

    return (
        title(key.controller),
        key.scenario,
        key.shown_setting,
        f'{found["decisions_per_s"]:.3g}',
        *cells('per_decision'),
        *cells('per_s'),
        str(len(laps)),
    )


def lap_steps(metrics: Mapping[str, Any]) -> float:
    """Return the steps of 50 ms of a completed drive's first lap, whatever its period was."""
    return float(round(metrics['lap_time_s'] * 1000 / PERIOD_MS))
