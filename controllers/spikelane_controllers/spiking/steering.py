"""From spikes to wheels: the steering model of paper section 4.3.

A neuron's activity is m = spikes / n_max. Two of them set a speed and a turn,

    a = m_left - m_right,  V = v_max - |a| (v_max - v_min),  S = turn a,

which are followed the faster the more active the neurons are,

    c = sqrt((m_left^2 + m_right^2) / 2),  v <- c V + (1 - c) v,  s <- c S + (1 - c) s,

and the wheels turn at v + s (left) and v - s (right): a more active left neuron turns right.

This is for steps of 50 ms. In a shorter step, of a share f of 50 ms, n_max is f times as large,
and so is c: that much less time has passed in which v and s could follow.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

from numba.extending import register_jitable

from spikelane_sim.contract import WheelVelocities
from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import parameter, Parameters

#: Names of the two motor neurons, in the order of spikes and rows of weights.
MOTOR_NEURONS = ('left', 'right')

_TABLE = 'table "Simulation parameters specification"'


@dataclasses.dataclass(frozen=True, kw_only=True)
class SteeringParameters(Parameters):
    """The steering model; speeds are of the wheels (see `WheelVelocities` for their unit)."""

    n_max: int = parameter(
        15,
        'Spikes of a neuron in 50 ms that count as full activity.',
        low=1,
        high=10_000,
        source=_TABLE,
    )
    v_min: float = parameter(
        1.0,
        'Mean wheel speed when only one neuron is active.',
        unit='rad/s',
        low=0.0,
        high=100.0,
        source=_TABLE,
    )
    v_max: float = parameter(
        1.5,
        'Mean wheel speed when both neurons are equally active.',
        unit='rad/s',
        low=0.0,
        high=100.0,
        source=_TABLE,
    )
    turn: float = parameter(
        0.5,
        'Difference of a wheel speed from the mean when only one neuron is active.',
        unit='rad/s',
        low=0.0,
        high=100.0,
        source=_TABLE,
    )

    def _check_relations(self) -> None:
        if self.v_max < self.v_min:
            raise ParameterError(
                f'v_max: expected at least v_min = {self.v_min:g} rad/s, got {self.v_max:g}'
            )


class SteeringConstants(NamedTuple):
    """The fields of `SteeringParameters`, for kernels."""

    n_max: int
    v_min: float
    v_max: float
    turn: float


class SteeringState(NamedTuple):
    """What is smoothed from step to step."""

    speed: float  # v, mean of the wheels [rad/s]
    turn: float  # s, half of left less right [rad/s], positive turns right


def initial_steering(parameters: SteeringParameters) -> SteeringState:
    """Return the steering at the start of an episode: straight on, slowly."""
    return SteeringState(parameters.v_min, 0.0)


@register_jitable
def steer(
    state: SteeringState,
    left_spikes: int,
    right_spikes: int,
    parameters: SteeringParameters,
    share: float = 1.0,
) -> tuple[SteeringState, WheelVelocities]:
    """Decode the spikes of one step.

    Activities are not limited to 1. With the paper's n_max of 15, which is under the 24 spikes
    that 2 ms of refractory period allow, a neuron that exceeds it steers beyond `turn` and
    brakes below v_min.

    Args:
        state: Steering after the step before.
        left_spikes: Spikes of the left neuron in this step.
        right_spikes: Spikes of the right neuron.
        parameters: The steering model; in a kernel a named tuple of the same fields.
        share: Length of the step in steps of 50 ms.

    Returns:
        The steering now, and the wheels' velocities that follow from it.
    """
    n_max = parameters.n_max * share
    left, right = left_spikes / n_max, right_spikes / n_max
    difference = left - right
    speed = parameters.v_max - abs(difference) * (parameters.v_max - parameters.v_min)
    turn = parameters.turn * difference
    c = share * math.sqrt((left * left + right * right) / 2)
    state = SteeringState(
        c * speed + (1 - c) * state.speed,
        c * turn + (1 - c) * state.turn,
    )
    return state, WheelVelocities(state.speed + state.turn, state.speed - state.turn)
