"""From messages to records: what is not valid is refused."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from spikelane_sim.errors import MessageError
from spikelane_sim.frame_names import WHEEL_JOINTS
from spikelane_sim.messages import (
    encoders_from_message,
    lane_state_from_message,
    to_stamp_ns,
)

NUMBERS = ('distance', 'heading_error', 'position', 'progress')


@pytest.mark.parametrize(
    ('seconds', 'nanoseconds', 'stamp_ns'),
    [(0, 0, 0), (1, 50_000_000, 1_050_000_000), (-1, 999_999_999, -1)],
)
def test_a_stamp_is_seconds_and_nanoseconds(seconds: int, nanoseconds: int, stamp_ns: int) -> None:
    """Added, where the nanoseconds are less than a second."""
    assert to_stamp_ns(SimpleNamespace(sec=seconds, nanosec=nanoseconds)) == stamp_ns


@pytest.mark.parametrize('nanoseconds', [1_000_000_000, 4_294_967_295])
def test_a_stamp_that_is_not_normalised_is_refused(nanoseconds: int) -> None:
    """It would be another name of a later time."""
    message = f'^stamp: expected nanosec below 1000000000, got {nanoseconds}$'
    with pytest.raises(MessageError, match=message):
        to_stamp_ns(SimpleNamespace(sec=0, nanosec=nanoseconds))


@pytest.mark.parametrize('name', NUMBERS)
@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf])
def test_a_lane_state_that_is_not_finite_is_refused(name: str, value: float) -> None:
    """A learning controller would make a reward of it."""
    facts = {'lane': 'outer', 'section': 'A', 'laps': 0, 'episode': 1, 'step': 3}
    fields = facts | dict.fromkeys(NUMBERS, 0.5) | {'terminated': False, 'reason': ''}
    assert lane_state_from_message(SimpleNamespace(**fields)).distance_m == 0.5
    with pytest.raises(MessageError, match='lane state: expected finite distance'):
        lane_state_from_message(SimpleNamespace(**fields | {name: value}))


def test_the_wheels_are_found_among_other_joints() -> None:
    """By their names; a message without them says nothing of the wheels."""
    names = ['arm', 'right_wheel_joint', 'left_wheel_joint']
    message = SimpleNamespace(name=names, position=[9.0, 0.2, 0.1], velocity=[8.0, 2.0, 1.0])
    assert encoders_from_message(message) == ((0.1, 0.2), (1.0, 2.0))
    message.name = ['arm', 'right_wheel_joint', 'leg']
    assert encoders_from_message(message) is None


@pytest.mark.parametrize(
    ('velocity', 'expected'),
    [
        ([1.0], 'a position and a velocity of each of 2 joints, got 2 and 1'),
        ([1.0, math.nan], 'finite'),
    ],
)
def test_joint_states_without_a_wheels_velocity_are_refused(
    velocity: list[float], expected: str
) -> None:
    """One is lacking, or not finite."""
    message = SimpleNamespace(name=WHEEL_JOINTS, position=[0.1, 0.2], velocity=velocity)
    with pytest.raises(MessageError, match=f'joint state: expected {expected}'):
        encoders_from_message(message)
