"""What is promised about speed and loss, each measured on this machine in one run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import json
import platform
import sys
from typing import Any, NamedTuple

from spikelane_benches.unavailable import BenchmarkUnavailableError
from spikelane_sim.errors import SpikelaneError

Result = dict[str, Any]


class Benchmark(NamedTuple):
    """A measurement and what is promised of it."""

    run: Callable[[], Result]
    figure: str  # key of the result that is promised
    promise: float
    is_at_least: bool  # whether more is better
    unit: str

    def is_kept(self, result: Result) -> bool:
        """Return whether the promise is kept."""
        value = result[self.figure]
        return bool(value >= self.promise if self.is_at_least else value <= self.promise)


def _pybullet() -> Result:
    from spikelane_benches.closed_loop import measure_closed_loop

    return measure_closed_loop('pybullet')


def _kinematic() -> Result:
    from spikelane_benches.closed_loop import measure_closed_loop

    return measure_closed_loop('kinematic')


def _rigid() -> Result:
    from spikelane_benches.closed_loop import measure_closed_loop

    return measure_closed_loop('rigid')


def _engines() -> Result:
    from spikelane_benches.engines import measure_engines

    return measure_engines()


def _fleet() -> Result:
    from spikelane_benches.fleet import measure_fleet

    return measure_fleet()


def _renderer() -> Result:
    from spikelane_benches.renderer import compare_renderers

    result = compare_renderers(60)
    result['iou_min'] = min(result.pop('iou_per_pose'))
    return result


def _lockstep() -> Result:
    from spikelane_benches.lockstep import measure_lockstep

    return measure_lockstep()


def _recorder() -> Result:
    from spikelane_benches.recorder import measure_recorder

    return measure_recorder()


def _plasticity() -> Result:
    from spikelane_benches.plasticity import measure_plasticity

    return measure_plasticity()


def _dqn() -> Result:
    from spikelane_benches.dqn import measure_dqn

    return measure_dqn()


def _q_learning() -> Result:
    from spikelane_benches.q_learning import measure_q_learning

    return measure_q_learning()


def _dqn_training() -> Result:
    from spikelane_benches.dqn_training import measure_dqn_training

    return measure_dqn_training()


def _real_time() -> Result:
    from spikelane_benches.real_time import measure_real_time

    return measure_real_time()


def _startup() -> Result:
    from spikelane_benches.startup import measure_startup

    return measure_startup()


BENCHMARKS: Mapping[str, Benchmark] = {
    'closed-loop-pybullet': Benchmark(_pybullet, 'steps_per_s', 1500, True, 'steps/s'),
    'closed-loop-rigid': Benchmark(_rigid, 'steps_per_s', 8000, True, 'steps/s'),
    'closed-loop-kinematic': Benchmark(_kinematic, 'steps_per_s', 8000, True, 'steps/s'),
    'engines': Benchmark(_engines, 'ratio', 30, True, "x pybullet, the robot's step"),
    'fleet': Benchmark(_fleet, 'ratio', 4, True, 'x the single simulator, R-STDP learning'),
    'renderer': Benchmark(_renderer, 'ratio', 30, True, 'x TinyRenderer'),
    'lockstep': Benchmark(_lockstep, 'round_trips', 1.3, False, 'round trips of a ping-pong'),
    'dqn': Benchmark(_dqn, 'ratio', 0.5, False, "of Stable-Baselines3's time"),
    'q-learning': Benchmark(_q_learning, 'ratio', 1.0, False, "of PyTorch's time, with Numba"),
    'dqn-training': Benchmark(
        _dqn_training, 'rigid_numba', 0.1, False, 'of the time with pybullet and PyTorch'
    ),
    'plasticity': Benchmark(_plasticity, 'ratio', 100, True, 'x NEST'),
    'real-time': Benchmark(
        _real_time, 'on_time_percent', 99.9, True, '% of answers within a period of 10 ms'
    ),
    'startup': Benchmark(_startup, 'beyond_numba_s', 0.3, False, 's beyond Numba, up to the loop'),
    'recorder': Benchmark(_recorder, 'lost', 0, False, 'messages lost'),
}


def run(names: Sequence[str], *, as_json: bool) -> int:
    """Measure and print; what cannot be measured here is skipped, with a message.

    Args:
        names: Names in BENCHMARKS; none for all.
        as_json: Whether one JSON object is printed, and not a row for each.

    Returns:
        0 where all that was promised and measured is kept, otherwise 1.

    Raises:
        SpikelaneError: A name is unknown, or a measurement failed.
    """
    for name in names:
        if name not in BENCHMARKS:
            raise SpikelaneError(f'expected {", ".join(BENCHMARKS)}, got {name!r}')
    results = {}
    for name in names or BENCHMARKS:
        benchmark = BENCHMARKS[name]
        print(f'measuring {name} ...', file=sys.stderr)
        try:
            result = benchmark.run()
        except BenchmarkUnavailableError as error:
            print(f'skipped {name}: {error}', file=sys.stderr)
            continue
        results[name] = {
            **result,
            'promised': benchmark.promise,
            'is_kept': benchmark.is_kept(result),
        }
        if not as_json:
            print(_row(name, benchmark, result))
    if as_json:
        print(json.dumps({'machine': _machine(), **results}))
    return 0 if all(result['is_kept'] for result in results.values()) else 1


def _row(name: str, benchmark: Benchmark, result: Result) -> str:
    bound = 'at least' if benchmark.is_at_least else 'at most'
    verdict = 'kept' if benchmark.is_kept(result) else 'MISSED'
    figures = ', '.join(f'{key} {_short(value)}' for key, value in result.items())
    value = _short(result[benchmark.figure])
    return (
        f'{name:22} {value:>9} {benchmark.unit} ({bound} {benchmark.promise:,}: {verdict})\n'
        f'{"":22} {figures}'
    )


def _short(value: object) -> str:
    return f'{value:,.4g}' if isinstance(value, float) else str(value)


def _machine() -> dict[str, Any]:
    return {'system': platform.platform(), 'processor': platform.machine(), 'python': sys.version}
