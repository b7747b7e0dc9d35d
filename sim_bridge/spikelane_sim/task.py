"""The paper's task around the simulator: three actions and a reward (sections 3.2 and 3.3)."""

from __future__ import annotations

from dataclasses import dataclass
import math

from numba.extending import register_jitable

from spikelane_sim.contract import WheelVelocities
from spikelane_sim.parameters import parameter, Parameters
from spikelane_sim.period import PERIOD_MS, SHORTEST_MS

#: By number, how an action adds the turning velocity to the left wheel.
_TURNS = (-1.0, 0.0, 1.0)
ACTIONS = ('left', 'straight', 'right')


@dataclass(frozen=True, kw_only=True)
class ActionParameters(Parameters):
    """Wheel velocities of the actions."""

    drive_rad_s: float = parameter(
        1.0,
        'Wheel velocity when driving straight on (v_s in the paper).',
        unit='rad/s',
        low=-100.0,
        high=100.0,
        source='paper, DQN parameters',
    )
    turn_rad_s: float = parameter(
        0.25,
        'Velocity added to one wheel and subtracted from the other in a turn (v_t in the paper).',
        unit='rad/s',
        low=-100.0,
        high=100.0,
        source='paper, DQN parameters',
    )


@dataclass(frozen=True, kw_only=True)
class DecisionParameters(ActionParameters):
    """Actions that hold for a while, and their reward."""

    steps_per_action: int = parameter(
        10,
        'For how long an action holds, in steps of step_ms whatever the control period.',
        low=1,
        high=1_000_000,
        source='paper section 3.2',
    )
    step_ms: int = parameter(
        PERIOD_MS,
        'Length of the steps that steps_per_action counts, rounded to whole control periods: less '
        'than 50 for actions that are shorter.',
        unit='ms',
        low=SHORTEST_MS,
        high=PERIOD_MS,
        source='paper section 3.2',
    )
    reward_sigma_m: float = parameter(
        0.15,
        'Standard deviation of the Gaussian reward.',
        unit='m',
        low=1e-6,
        high=1000.0,
        source='paper section 3.3',
    )


def action_wheels(action: int, parameters: ActionParameters) -> WheelVelocities:
    """Return the wheel velocities of an action, an index of ACTIONS."""
    turn = _TURNS[action] * parameters.turn_rad_s
    return WheelVelocities(parameters.drive_rad_s + turn, parameters.drive_rad_s - turn)


@register_jitable
def lane_centre_reward(distance_m: float, sigma_m: float) -> float:
    """Return the normal density of the lane distance [m] (paper section 3.3)."""
    return math.exp(-((distance_m / sigma_m) ** 2) / 2) / (sigma_m * math.sqrt(2 * math.pi))
