"""The steering model by hand."""

from __future__ import annotations

import math

import pytest

from spikelane_controllers.spiking.steering import (
    initial_steering,
    steer,
    SteeringParameters,
    SteeringState,
)
from spikelane_sim.errors import ParameterError

PAPER = SteeringParameters()


def test_an_episode_begins_straight_and_slow() -> None:
    """At reset v = v_min and s = 0."""
    assert initial_steering(PAPER) == (1.0, 0.0)


def test_several_steps_follow_the_equations() -> None:
    """Literals worked out on paper for n_max = 15.

    15 and 0 spikes: m = (1, 0), a = 1, V = 1.0, S = 0.5, c = sqrt(1/2) = 0.7071068, so
    v = 1, s = 0.3535534. 6 and 9: m = (0.4, 0.6), a = -0.2, V = 1.4, S = -0.1,
    c = sqrt(0.26) = 0.5099020, so v = 1.2039608, s = 0.1222856.
    """
    state, wheels = steer(initial_steering(PAPER), 15, 0, PAPER)
    assert state == pytest.approx((1.0, 0.3535534))
    assert wheels == pytest.approx((1.3535534, 0.6464466))
    state, wheels = steer(state, 6, 9, PAPER)
    assert state == pytest.approx((1.2039608, 0.1222856), rel=1e-6)
    assert wheels == pytest.approx((1.3262464, 1.0816752), rel=1e-6)


def test_silence_keeps_what_was() -> None:
    """Without spikes c = 0."""
    state = SteeringState(1.23, -0.4)
    assert steer(state, 0, 0, PAPER) == (state, (1.23 - 0.4, 1.23 + 0.4))


def test_a_more_active_left_neuron_turns_right() -> None:
    """The left wheel is then the faster one."""
    _, wheels = steer(initial_steering(PAPER), 12, 3, PAPER)
    assert wheels.left > wheels.right


def test_full_activity_of_both_is_full_speed_at_once() -> None:
    """25 of 25 spikes: c = 1, a = 0."""
    parameters = SteeringParameters(n_max=25)
    assert steer(SteeringState(1.0, 0.5), 25, 25, parameters)[1] == (1.5, 1.5)


def test_a_largest_speed_below_the_smallest_is_refused() -> None:
    """The message says which is which."""
    with pytest.raises(ParameterError, match='v_max: expected at least v_min = 1 rad/s, got'):
        SteeringParameters(v_max=0.5)


def test_in_a_shorter_step_fewer_spikes_are_full_activity_and_less_is_followed() -> None:
    """In 10 ms 3 spikes are as 15 in 50 ms; c = 0.2 of sqrt(1 / 2)."""
    c = 0.2 * math.sqrt(0.5)
    state, wheels = steer(SteeringState(1.2, 0.1), 3, 0, PAPER, 0.2)
    assert state == pytest.approx((c * 1.0 + (1 - c) * 1.2, c * 0.5 + (1 - c) * 0.1))
    assert wheels == pytest.approx((state[0] + state[1], state[0] - state[1]))
