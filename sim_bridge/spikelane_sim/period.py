"""The control period: how long one step lasts, for simulator, sensor and controller alike.

It is the parameter `period_ms` of the simulator and of each controller that depends on it, whole
milliseconds from 5 to 50. Whatever a parameter counts "in steps of 50 ms" keeps that unit with
every period: `TimedParameters.share` converts it. Actions and images can count shorter steps.
"""

from __future__ import annotations

from dataclasses import dataclass
import functools

from spikelane_sim.parameters import parameter, Parameters

#: Period of the paper, and the default [ms] (section 3.2: an event frame every 50 ms).
PERIOD_MS = 50
SHORTEST_MS = 5

_NS_PER_MS = 1_000_000
PERIOD_NS = PERIOD_MS * _NS_PER_MS


def steps_of(count: int, step_ms: int, period_ms: int) -> int:
    """Return how many periods take as long as a number of other steps, rounded; at least 1."""
    return max(1, round(count * step_ms / period_ms))


@dataclass(frozen=True, kw_only=True)
class TimedParameters(Parameters):
    """Parameters of what goes in steps of the control period."""

    period_ms: int = parameter(
        PERIOD_MS,
        'Control period: the length of a step, the same for simulator and controller.',
        unit='ms',
        low=SHORTEST_MS,
        high=PERIOD_MS,
        source='paper section 3.2',
    )

    @property
    def period_ns(self) -> int:
        """Length of a step [ns]."""
        return self.period_ms * _NS_PER_MS

    @property
    def period_s(self) -> float:
        """Length of a step."""
        return self.period_ns / 1e9

    @functools.cached_property
    def share(self) -> float:
        """Length of a step in steps of 50 ms, from 0.1 to 1."""
        return self.period_ms / PERIOD_MS

    def steps_of(self, count: int, step_ms: int = PERIOD_MS) -> int:
        """Return how many steps take as long as a number of steps of step_ms; at least 1."""
        return steps_of(count, step_ms, self.period_ms)
