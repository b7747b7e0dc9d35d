"""What a base is told: limits, the dead-man switch and the watchdogs, at times that are given."""

import math

import pytest

from spikelane_sim.drive_limiter import approach, BaseParameters, DriveLimiter, STILL
from spikelane_sim.robots.differential_drive import BodyVelocity

SLOW = BodyVelocity(0.2, 0.1)


def limiter(**parameters: object) -> DriveLimiter:
    """Return one that takes commands of `wheels` and watches `events`, too."""
    base = BaseParameters.from_mapping(parameters)
    return DriveLimiter(base, 'wheels', ('events',), max_events_per_s=1000.0)


def drive(limiter: DriveLimiter, now_s: float, wanted: BodyVelocity = SLOW) -> BodyVelocity | None:
    """Let events and a command come."""
    limiter.hear('events', now_s)
    return limiter.command(wanted, now_s)


def test_a_command_within_the_limits_is_driven_as_it_is() -> None:
    """At once: there is no limit of acceleration by default."""
    assert drive(limiter(), 10.0) == SLOW


def test_a_command_that_is_too_fast_is_slowed_down_on_its_path() -> None:
    """The quotient of both velocities, the curvature, stays."""
    limited = limiter(max_linear_m_s=0.5, max_angular_rad_s=1.0)
    assert drive(limited, 0.0, BodyVelocity(1.0, 1.0)) == pytest.approx((0.5, 0.5))
    assert drive(limited, 0.1, BodyVelocity(-0.2, 2.0)) == pytest.approx((-0.1, 1.0))
    assert limited.counts['limited'] == 2


@pytest.mark.parametrize('number', [math.nan, math.inf, -math.inf])
def test_a_command_that_is_not_finite_stops_the_robot_until_the_next(number: float) -> None:
    """It says nothing about the next one."""
    limited = limiter()
    assert drive(limited, 0.0) == SLOW
    assert drive(limited, 0.1, BodyVelocity(0.1, number)) == STILL
    assert drive(limited, 0.2) == SLOW
    assert limited.counts['not_finite'] == 1


def test_the_robot_speeds_up_and_slows_down_by_its_acceleration() -> None:
    """0.5 m/s2 and steps of 50 ms: 0.025 m/s each; a first command counts as 0.1 s."""
    limited = limiter(max_linear_m_s2=0.5)
    fast = BodyVelocity(0.2, 0.0)
    told = [drive(limited, 0.05 * step, fast).forward_m_s for step in range(8)]
    assert told == pytest.approx([0.05, 0.075, 0.1, 0.125, 0.15, 0.175, 0.2, 0.2])
    slower = [drive(limited, 0.05 * step, STILL).forward_m_s for step in range(8, 11)]
    assert slower == pytest.approx([0.175, 0.15, 0.125])


def test_the_robot_speeds_up_on_the_path_that_it_is_to_drive() -> None:
    """Both velocities wait for the one that takes longer."""
    assert approach(STILL, BodyVelocity(0.4, 1.0), 0.1, 1.0) == pytest.approx((0.1, 0.25))
    assert approach(STILL, BodyVelocity(0.4, 1.0), 1.0, 0.1) == pytest.approx((0.04, 0.1))
    assert approach(BodyVelocity(0.4, 0.0), STILL, 0.1, 1.0) == pytest.approx((0.3, 0.0))
    assert approach(STILL, BodyVelocity(0.4, 1.0), 0.4, 1.0) == (0.4, 1.0)
    assert approach(STILL, BodyVelocity(0.4, 1.0), 0.0, 1.0) == STILL


def test_time_that_is_set_back_accelerates_nobody() -> None:
    """As a simulator's is by a reset."""
    limited = limiter(max_linear_m_s2=0.5)
    first = drive(limited, 100.0, BodyVelocity(0.5, 0.0))
    assert drive(limited, 1.0, BodyVelocity(0.5, 0.0)) == first
    assert limited.look(1.15) is None
    assert limited.look(1.25) == STILL


@pytest.mark.parametrize(('silent', 'other'), [('events', 'wheels'), ('wheels', 'events')])
def test_a_silent_source_stops_the_robot(silent: str, other: str) -> None:
    """Three times, at once and whatever the acceleration; then the topic is left to others."""
    limited = limiter(max_linear_m_s2=0.5)
    for step in range(6):
        drive(limited, 0.05 * step)
    for step in range(6, 10):
        if other == 'wheels':
            assert limited.command(SLOW, 0.05 * step) not in (None, STILL)
        else:
            limited.hear('events', 0.05 * step)
            assert limited.look(0.05 * step) is None
    assert [limited.look(now_s) for now_s in (0.4501, 0.47, 0.48, 0.49)] == [STILL] * 3 + [None]
    assert limited.reason is not None
    assert limited.reason.text == f'{silent}: none came for 0.2 s'
    assert limited.counts['timeouts'] == 1
    assert limited.last == STILL
    # It speeds up again from standstill.
    assert drive(limited, 2.0) == pytest.approx((0.05, 0.025))
    assert limited.reason is None


def test_nothing_is_told_before_all_sources_were_heard() -> None:
    """The topic may be another's."""
    limited = limiter()
    assert limited.look(0.0) is None
    assert limited.command(SLOW, 0.1) is None
    assert limited.look(5.0) is None
    assert limited.counts['timeouts'] == 0
    assert drive(limited, 5.1) == SLOW


def test_the_robot_drives_only_while_the_switch_is_held() -> None:
    """Released it is told so at once; so where the switch itself is silent."""
    limited = limiter(dead_man='joystick')
    assert drive(limited, 0.0) is None
    assert limited.reason is not None
    assert limited.reason.text == 'dead-man switch: none came yet'
    limited.hear_dead_man(True, 0.1)
    assert drive(limited, 0.1) == SLOW
    limited.hear_dead_man(False, 0.12)
    assert [limited.look(0.12), drive(limited, 0.13), limited.look(0.14)] == [STILL] * 3
    assert drive(limited, 0.15) is None
    assert limited.counts['releases'] == 1
    limited.hear_dead_man(True, 0.2)
    assert drive(limited, 0.2) == SLOW
    assert drive(limited, 0.4) == SLOW
    assert drive(limited, 0.401) == STILL
    assert limited.reason.text == 'dead-man switch: none came for 0.2 s'


def test_too_many_events_stop_the_robot_within_a_tenth_of_a_second() -> None:
    """Until fewer come: the limit is 1000 a second."""
    limited = limiter()

    def see(events: int, now_s: float) -> BodyVelocity | None:
        limited.hear_events(events, now_s)
        return drive(limited, now_s)

    assert [see(9, 0.01 * step) for step in range(30)] == [SLOW] * 30
    told = [see(30, 0.3 + 0.01 * step) for step in range(13)]
    assert STILL in told[:11]
    assert told[12] in (None, STILL)
    assert limited.counts['floods'] == 1
    assert limited.reason is not None
    assert limited.reason.text.startswith('events: expected at most 1000 a second, got ')
    told = [see(9, 0.43 + 0.01 * step) for step in range(25)]
    assert told[-1] == SLOW


def test_one_packet_of_many_events_after_a_pause_is_a_flood() -> None:
    """The pause does not thin it out."""
    limited = limiter(timeout_s=60.0)
    limited.hear_events(9, 0.0)
    drive(limited, 0.0)
    limited.hear_events(5000, 30.0)
    assert drive(limited, 30.0) == STILL


def test_events_that_waited_for_too_long_stop_the_robot() -> None:
    """What they show is past; it drives on once they are answered in time."""
    limited = limiter()
    for waited_s in (0.0, 0.19, 0.2):
        limited.hear_lag(waited_s)
        assert drive(limited, 1.0) == SLOW
    limited.hear_lag(0.43)
    assert [drive(limited, 1.0) for _ in range(4)] == [STILL] * 3 + [None]
    assert limited.reason is not None
    assert limited.reason.text == (
        'events: expected to be answered within 0.2 s, waited 0.43 s for their turn'
    )
    assert limited.counts['lags'] == 1
    limited.hear_lag(0.1)
    assert drive(limited, 1.1) == SLOW


def test_a_robot_on_hold_stands_until_it_is_released() -> None:
    """The reason that was given comes before all others."""
    limited = limiter()
    drive(limited, 0.0)
    limited.hold('the episode is over')
    assert drive(limited, 0.05) == STILL
    assert limited.look(9.0) == STILL
    assert limited.reason is not None
    assert limited.reason.text == 'the episode is over'
    limited.release()
    assert drive(limited, 9.1) == SLOW
