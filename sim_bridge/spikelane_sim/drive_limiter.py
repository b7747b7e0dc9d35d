"""What a robot's base is told: velocity limits, a dead-man switch, and watchdogs that stop it.

All nodes that publish `cmd_vel` ask one `DriveLimiter`. It reads no clock: whoever calls says what
time it is, the simulation's or the wall's.

- A command that is faster than a limit is slowed down along the same path.
- The velocity moves towards the command in a straight line in the plane of forward velocity and
  turning rate, as fast as both limits of acceleration allow. From standstill the robot therefore
  begins on the path that it is to drive.
- A stop is not slowed down: the base is told to stand at once, three times, since it may be told
  best-effort. The topic is then left to others that may drive, until the reason is gone.
- Reasons to stop are a source that has been silent for too long, a dead-man switch that is not
  held, events that waited for too long before they were answered, more events a second than are
  allowed, and `hold`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import NamedTuple

from spikelane_sim.frame_names import WHEEL_JOINTS
from spikelane_sim.parameters import parameter, Parameters
from spikelane_sim.robots.differential_drive import BodyVelocity

STILL = BodyVelocity(0.0, 0.0)
#: How often a robot is told to stop.
STOPS = 3
#: Kinds of dead-man switches.
DEAD_MAN_KINDS = ('none', 'joystick', 'bool')
#: Name of the source that says whether the dead-man switch is held.
DEAD_MAN = 'dead-man switch'

#: Commands that come less often accelerate the robot as if they came that often [s].
_LONGEST_STEP_S = 0.1
#: Events are counted for this long before their rate is judged [s].
_RATE_WINDOW_S = 0.1


@dataclass(frozen=True, kw_only=True)
class BaseParameters(Parameters):
    """The robot's base, its limits, and when it is stopped."""

    wheel_radius_m: float = parameter(
        0.0,
        "Radius of the wheels; 0: the radius in the robot's URDF.",
        unit='m',
        low=0.0,
        high=10.0,
    )
    track_m: float = parameter(
        0.0,
        "Distance between the wheels; 0: the distance in the robot's URDF.",
        unit='m',
        low=0.0,
        high=10.0,
    )
    urdf_file: str = parameter(
        '',
        "File of the robot's URDF; empty: the URDF is received on robot_description, where it "
        'is needed.',
    )
    left_joint: str = parameter(
        WHEEL_JOINTS[0], 'Name of the joint of the left wheel in the URDF.'
    )
    right_joint: str = parameter(
        WHEEL_JOINTS[1], 'Name of the joint of the right wheel in the URDF.'
    )
    frame_id: str = parameter('base_link', 'Frame of the TwistStamped messages.')
    max_linear_m_s: float = parameter(
        0.5,
        'Largest velocity, forwards or backwards; a faster command is slowed down along the '
        'same path.',
        unit='m/s',
        low=0.0,
        high=100.0,
    )
    max_angular_rad_s: float = parameter(
        1.5,
        'Largest turning rate in either direction; a faster command is slowed down along the '
        'same path.',
        unit='rad/s',
        low=0.0,
        high=100.0,
    )
    max_linear_m_s2: float = parameter(
        0.0,
        'Largest acceleration forwards or backwards, also when braking on command; 0: no limit. '
        'A stop by a watchdog or the dead-man switch is immediate.',
        unit='m/s2',
        low=0.0,
        high=1000.0,
    )
    max_angular_rad_s2: float = parameter(
        0.0,
        'Largest change of the turning rate; 0: no limit.',
        unit='rad/s2',
        low=0.0,
        high=1000.0,
    )
    timeout_s: float = parameter(
        0.2,
        'The robot is stopped when nothing has come for this time from a source that is watched, '
        'which is simulation time if use_sim_time is true. A controller node also stops it when '
        'a packet of events had waited for longer than this when its turn came.',
        unit='s',
        low=0.05,
        high=3600.0,
    )
    dead_man: str = parameter(
        'none',
        'Dead-man switch that must be held for the robot to drive: a button of the joystick on '
        'joy (joystick), true on dead_man_switch (bool), or none. Messages must come again '
        'within timeout_s.',
        choices=DEAD_MAN_KINDS,
    )
    dead_man_button: int = parameter(
        0, 'Index of the button of the joystick that is to be held.', low=0, high=255
    )


class Reason(NamedTuple):
    """Why the robot is stopped, and what to say once it is not."""

    kind: str  # of the counts
    text: str
    over: str


class DriveLimiter:
    """Decides what a base is told, as the module says.

    Attributes:
        last: What it was told last.
        reason: Why it is stopped; None while it may drive.
        counts: Commands limited and not finite, and stops by their kind.
    """

    def __init__(
        self,
        parameters: BaseParameters,
        command: str,
        others: Sequence[str] = (),
        max_events_per_s: float = 0.0,
    ) -> None:
        """Begin stopped: nothing was heard yet.

        Args:
            parameters: Limits, timeout and dead-man switch.
            command: Name of the source of the commands, which is watched.
            others: Names of further sources that are watched.
            max_events_per_s: Most events a second with which the robot may drive; 0: any.
        """
        self._parameters = parameters
        self._command = command
        self._is_held = parameters.dead_man == 'none'
        switch = () if self._is_held else (DEAD_MAN,)
        self._heard_s: dict[str, float | None] = dict.fromkeys((*switch, *others, command))
        self._max_rate = max_events_per_s
        self._rate = 0.0
        self._events, self._since_s = 0, -math.inf
        self._lag_s = 0.0
        self._hold: Reason | None = None
        self._commanded_s = -math.inf
        self._has_driven = False
        self._stops_left = 0
        self.last = STILL
        kinds = ('limited', 'not_finite', 'timeouts', 'releases', 'lags', 'floods', 'holds')
        self.counts: Counter[str] = Counter(dict.fromkeys(kinds, 0))
        self.reason: Reason | None = self._reason_to_stop(0.0)

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of all sources that are watched."""
        return tuple(self._heard_s)

    def may_drive(self, now_s: float) -> bool:
        """Return whether a command would be driven, if one came."""
        return self._reason_to_stop(now_s, needs_command=False) is None

    def is_silent(self, source: str, now_s: float) -> bool:
        """Return whether nothing has come from a source for too long, or ever."""
        return self._silence(source, now_s) is not None

    def hear(self, source: str, now_s: float) -> None:
        """Note that something has come from a source.

        Args:
            source: One of `sources`.
            now_s: The time.
        """
        self._heard_s[source] = now_s

    def hear_dead_man(self, is_held: bool, now_s: float) -> None:
        """Note whether the dead-man switch is held."""
        self._heard_s[DEAD_MAN] = now_s
        self._is_held = is_held

    def hear_events(self, count: int, now_s: float) -> None:
        """Note that so many events came, to judge their rate."""
        self._events += count
        seconds = now_s - self._since_s
        if seconds < 0 or seconds >= _RATE_WINDOW_S:
            # After a pause the events are those of a moment, whatever the pause was.
            self._rate = self._events / min(max(seconds, _RATE_WINDOW_S), 2 * _RATE_WINDOW_S)
            self._events, self._since_s = 0, now_s

    def hear_lag(self, lag_s: float) -> None:
        """Note how long events had waited when their turn to be answered came [s]."""
        self._lag_s = lag_s

    def hold(self, text: str, over: str = 'the robot may drive again') -> None:
        """Let the robot stand until `release`.

        Args:
            text: Why.
            over: What to say once it may drive.
        """
        self._hold = Reason('holds', text, over)

    def release(self) -> None:
        """Take back `hold`."""
        self._hold = None

    def command(self, wanted: BodyVelocity, now_s: float) -> BodyVelocity | None:
        """Take a command.

        Args:
            wanted: How the body is to move; what is not finite stops it.
            now_s: The time.

        Returns:
            What the base is to be told; None for nothing, since others may drive it.
        """
        self._heard_s[self._command] = now_s
        if self._look(now_s):
            return self._next_stop()
        self._has_driven = True
        if not all(map(math.isfinite, wanted)):
            self.counts['not_finite'] += 1
            self.last = STILL
            return STILL
        limits = self._parameters
        limited = wanted.limited(limits.max_linear_m_s, limits.max_angular_rad_s)
        self.counts['limited'] += limited != wanted
        # Time may be set back, by a simulator or an administrator.
        step_s = min(max(now_s - self._commanded_s, 0.0), _LONGEST_STEP_S)
        self._commanded_s = now_s
        most = (
            limit * step_s if limit else math.inf
            for limit in (limits.max_linear_m_s2, limits.max_angular_rad_s2)
        )
        self.last = approach(self.last, limited, *most)
        return self.last

    def look(self, now_s: float) -> BodyVelocity | None:
        """Find out whether the robot is to be stopped; to be called often.

        Returns:
            What the base is to be told; None for nothing.
        """
        return self._next_stop() if self._look(now_s) else None

    def _look(self, now_s: float) -> bool:
        """Update the reason; return whether there is one."""
        reason = self._reason_to_stop(now_s)
        if reason is not None and self._has_driven:
            self._has_driven, self._stops_left = False, STOPS
            self.counts[reason.kind] += 1
        self.reason = reason
        return reason is not None

    def _next_stop(self) -> BodyVelocity | None:
        self.last = STILL
        if not self._stops_left:
            return None
        self._stops_left -= 1
        return STILL

    def _reason_to_stop(self, now_s: float, *, needs_command: bool = True) -> Reason | None:
        if self._hold is not None:
            return self._hold
        for source in self._heard_s:
            if source == self._command:
                continue
            if reason := self._silence(source, now_s):
                return reason
            if source == DEAD_MAN and not self._is_held:
                return Reason('releases', f'{DEAD_MAN}: not held', f'{DEAD_MAN}: held')
        if self._lag_s > self._parameters.timeout_s:
            text = (
                f'events: expected to be answered within {self._parameters.timeout_s:g} s, '
                f'waited {self._lag_s:.2f} s for their turn'
            )
            return Reason('lags', text, 'events: answered in time again')
        if self._max_rate and self._rate > self._max_rate:
            text = f'events: expected at most {self._max_rate:g} a second, got {self._rate:.3g}'
            return Reason('floods', text, 'events: no more than expected come')
        # It may be silent because of any of these.
        return self._silence(self._command, now_s) if needs_command else None

    def _silence(self, source: str, now_s: float) -> Reason | None:
        """Return the reason where nothing has come from a source for too long."""
        heard_s, timeout_s = self._heard_s[source], self._parameters.timeout_s
        if heard_s is None:
            return Reason('timeouts', f'{source}: none came yet', f'{source}: they come')
        if heard_s > now_s:  # time was set back
            self._heard_s[source] = now_s
        elif now_s - heard_s > timeout_s:
            text = f'{source}: none came for {timeout_s:g} s'
            return Reason('timeouts', text, f'{source}: they come again')
        return None


def approach(
    now: BodyVelocity, wanted: BodyVelocity, forward_m_s: float, turn_rad_s: float
) -> BodyVelocity:
    """Return a velocity on the straight line from one to another, as far on as is allowed.

    Args:
        now: The velocity now.
        wanted: The velocity to come to.
        forward_m_s: Largest change forward or backward.
        turn_rad_s: Largest change of the turning rate.
    """
    changes = (wanted.forward_m_s - now.forward_m_s, wanted.turn_rad_s - now.turn_rad_s)
    pairs = zip(changes, (forward_m_s, turn_rad_s), strict=True)
    share = min([1.0, *(most / abs(change) for change, most in pairs if most < abs(change))])
    if share == 1.0:
        return wanted
    return BodyVelocity(now.forward_m_s + share * changes[0], now.turn_rad_s + share * changes[1])
