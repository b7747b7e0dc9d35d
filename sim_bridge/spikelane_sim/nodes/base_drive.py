"""Publishes `cmd_vel` for a robot's base: what every node does that drives one.

The robot must stop where nobody drives it: when commands or what they depend on fail to come, when
the dead-man switch is not held, when commands are not finite, and when the node ends, the base is
told so. A node that is killed can tell nothing: the base needs a timeout of its own, as all that
take `cmd_vel` have.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math
from pathlib import Path
import threading

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Joy
from std_msgs.msg import Bool, String

from spikelane_sim import topic_names
from spikelane_sim.contract import WheelVelocities
from spikelane_sim.drive_limiter import BaseParameters, DriveLimiter, Reason, STILL
from spikelane_sim.errors import ParameterError
from spikelane_sim.nodes.meeting import LATCHED
from spikelane_sim.nodes.waiting import publishers_of
from spikelane_sim.robots.differential_drive import BodyVelocity, DriveGeometry, read_geometry

_QOS = QoSProfile(depth=10)
#: A best-effort subscription receives from whoever publishes, and only the latest matters.
_SWITCH = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
_LOOK_PERIOD_S = 0.02


class BaseDrive:
    """One publisher of `cmd_vel`, and what decides about it.

    Times are the simulation's where the node has `use_sim_time`, which may stand still, and the
    robot with it; otherwise they are steady, since wall time may be set. Messages come in one
    thread, the signal that ends the node in another, and a controller may hang in a third: all
    may call at once.
    """

    def __init__(
        self,
        node: Node,
        parameters: BaseParameters,
        source: str,
        *,
        is_stamped: bool,
        others: Sequence[str] = (),
        max_events_per_s: float = 0.0,
        on_geometry: Callable[[str], None] = lambda text: None,
    ) -> None:
        """Find out about the robot, or begin to wait for that, and begin to watch.

        Args:
            node: The node that publishes.
            parameters: The base.
            source: What commands come from, as the log calls it.
            is_stamped: Whether `cmd_vel` is a TwistStamped instead of a Twist.
            others: As of `DriveLimiter`.
            max_events_per_s: As of `DriveLimiter`.
            on_geometry: Called with a text that describes the base, once its size is known.

        Raises:
            SpikelaneError: The URDF does not say what is needed.
        """
        self._node, self._parameters, self._source = node, parameters, source
        self._is_stamped, self._on_geometry = is_stamped, on_geometry
        self._lock = threading.Lock()
        self._is_halted = False
        self._limiter = DriveLimiter(parameters, source, others, max_events_per_s)
        self._said: Reason | None = self._limiter.reason
        self.counts = dict.fromkeys(('received', 'published', 'ignored'), 0)
        kind = TwistStamped if is_stamped else Twist
        self._publisher = node.create_publisher(kind, topic_names.TWIST, _QOS)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        is_simulated = bool(node.get_parameter('use_sim_time').value)
        self._clock = node.get_clock() if is_simulated else steady
        self.geometry = self._find_geometry()
        self._subscribe_switch()
        node.create_timer(
            _LOOK_PERIOD_S, self._look, MutuallyExclusiveCallbackGroup(), clock=steady
        )

    @property
    def is_driving(self) -> bool:
        """Whether commands reach the base."""
        return self.geometry is not None and self._limiter.reason is None

    @property
    def may_drive(self) -> bool:
        """Whether the base would be driven, if a command came."""
        with self._lock:
            return self.geometry is not None and self._limiter.may_drive(self._now_s)

    def is_silent(self, source: str) -> bool:
        """Return whether nothing has come from a source for too long, or ever."""
        with self._lock:
            return self._limiter.is_silent(source, self._now_s)

    def hear(self, source: str, events: int | None = None, waited_s: float | None = None) -> None:
        """Note that something has come from one of the sources.

        Args:
            source: Its name.
            events: How many events came, of a camera.
            waited_s: How long they had waited for their turn to be answered.
        """
        with self._lock:
            now_s = self._now_s
            self._limiter.hear(source, now_s)
            if events is not None:
                self._limiter.hear_events(events, now_s)
            if waited_s is not None:
                self._limiter.hear_lag(waited_s)

    def hold(self, text: str, over: str) -> None:
        """Let the robot stand until `release`; as `DriveLimiter.hold`."""
        with self._lock:
            self._limiter.hold(text, over)
        self._look()

    def release(self) -> None:
        """Take back `hold`."""
        with self._lock:
            self._limiter.release()
        self._look()

    def drive(self, wheels: WheelVelocities) -> None:
        """Tell the base what wheel velocities [rad/s] mean for it, where it may drive."""
        with self._lock:
            self.counts['received'] += 1
            if self.geometry is None or self._is_halted:
                self.counts['ignored'] += 1
                return
            wanted = self.geometry.body_velocity(wheels)
            before = self._limiter.counts['limited']
            told = self._limiter.command(wanted, self._now_s)
            self._say_reason()
            if told is not None:
                self._publish(told)
        self._say_what_is_odd(wheels, wanted, self._limiter.counts['limited'] > before)

    def halt(self) -> None:
        """Tell the base to stand, and nothing more; at the end, and from any thread."""
        with self._lock:
            if not self._is_halted and self._node.context.ok():
                self._publish(STILL)
            self._is_halted = True

    def lacks(self) -> str:
        """Return why the base is not driven; '' where it is."""
        if self.geometry is None:
            topic = topic_names.ROBOT_DESCRIPTION
            count = publishers_of(self._node, topic)
            return (
                f'waiting for {topic}, which says how large the wheels are; {count} publishers '
                'are there (or give wheel_radius_m and track_m, or urdf_file)'
            )
        reason = self._limiter.reason
        return '' if reason is None else f'the robot is stopped: {reason.text}'

    def values(self) -> dict[str, object]:
        """Return counts, the last velocity and the base's size, for diagnostics."""
        with self._lock:
            geometry, last = self.geometry, self._limiter.last
            return {
                **self.counts,
                **self._limiter.counts,
                'linear_m_s': last.forward_m_s,
                'angular_rad_s': last.turn_rad_s,
                **({} if geometry is None else geometry._asdict()),
            }

    @property
    def _now_s(self) -> float:
        return float(self._clock.now().nanoseconds) / 1e9

    def _subscribe_switch(self) -> None:
        """Subscribe to the dead-man switch, where there is one."""
        kind = self._parameters.dead_man
        if kind == 'joystick':
            self._node.create_subscription(Joy, topic_names.JOYSTICK, self._on_joy, _SWITCH)
        elif kind == 'bool':
            self._node.create_subscription(
                Bool,
                topic_names.DEAD_MAN,
                lambda message: self._hear_switch(bool(message.data)),
                _SWITCH,
            )

    def _on_joy(self, message: Joy) -> None:
        buttons, index = message.buttons, self._parameters.dead_man_button
        if index >= len(buttons):
            self._node.get_logger().error(
                f'{topic_names.JOYSTICK}: expected a button {index}, got {len(buttons)} buttons; '
                'taken as not held',
                throttle_duration_sec=1.0,
            )
        self._hear_switch(index < len(buttons) and bool(buttons[index]))

    def _hear_switch(self, is_held: bool) -> None:
        with self._lock:
            self._limiter.hear_dead_man(is_held, self._now_s)
        self._look()

    def _find_geometry(self) -> DriveGeometry | None:
        """Return what is known of the robot; where it is not enough, subscribe to what is."""
        base = self._parameters
        if base.wheel_radius_m and base.track_m:
            return self._told(DriveGeometry(base.wheel_radius_m, base.track_m))
        if base.urdf_file:
            try:
                text = Path(base.urdf_file).read_text(encoding='utf-8')
                return self._told(self._read(text))
            except OSError as error:
                raise ParameterError(f'urdf_file: {base.urdf_file}: {error.strerror}') from None
            except (ParameterError, UnicodeDecodeError) as error:
                raise ParameterError(f'urdf_file: {base.urdf_file}: {error}') from None
        self._node.create_subscription(
            String, topic_names.ROBOT_DESCRIPTION, self._on_description, LATCHED
        )
        return None

    def _read(self, urdf: str) -> DriveGeometry:
        """Return what a URDF says, where no parameter does."""
        base = self._parameters
        found = read_geometry(urdf, base.left_joint, base.right_joint)
        return DriveGeometry(
            base.wheel_radius_m or found.wheel_radius_m, base.track_m or found.track_m
        )

    def _told(self, geometry: DriveGeometry) -> DriveGeometry:
        """Return the geometry, which is told: the base can be driven."""
        kind = 'TwistStamped' if self._is_stamped else 'Twist'
        self._on_geometry(
            f'{self._source} to {topic_names.TWIST} ({kind}), wheel radius '
            f'{geometry.wheel_radius_m:g} m, track {geometry.track_m:g} m, at most '
            f'{self._parameters.max_linear_m_s:g} m/s and '
            f'{self._parameters.max_angular_rad_s:g} rad/s'
        )
        return geometry

    def _on_description(self, message: String) -> None:
        try:
            geometry = self._read(message.data)
        except ParameterError as error:
            self._node.get_logger().error(f'{topic_names.ROBOT_DESCRIPTION}: {error}; refused')
            return
        if geometry != self.geometry:
            self.geometry = self._told(geometry)

    def _look(self) -> None:
        """Stop the robot where there is a reason."""
        with self._lock:
            if self._is_halted:
                return
            told = self._limiter.look(self._now_s)
            self._say_reason()
            if told is not None:
                self._publish(told)

    def _say_reason(self) -> None:
        """Say in the log why the robot is stopped, where that is new, and when it is over."""
        before, reason = self._said, self._limiter.reason
        self._said = reason
        if reason is not None and (before is None or before.over != reason.over):
            self._node.get_logger().warning(f'{reason.text}; the robot is stopped')
        elif reason is None and before is not None:
            self._node.get_logger().info(before.over)

    def _say_what_is_odd(
        self, wheels: WheelVelocities, wanted: BodyVelocity, is_limited: bool
    ) -> None:
        if not all(map(math.isfinite, wanted)):
            self._node.get_logger().error(
                f'{self._source}: expected finite rad/s, got {wheels.left} and '
                f'{wheels.right}; the robot is stopped',
                throttle_duration_sec=1.0,
            )
        elif is_limited:
            self._node.get_logger().warning(
                f'{self._source}: they mean {wanted.forward_m_s:.3g} m/s and '
                f'{wanted.turn_rad_s:.3g} rad/s; limited',
                throttle_duration_sec=1.0,
            )

    def _publish(self, velocity: BodyVelocity) -> None:
        twist = Twist()
        twist.linear.x, twist.angular.z = velocity
        message = twist
        if self._is_stamped:
            message = TwistStamped(twist=twist)
            message.header.stamp = self._node.get_clock().now().to_msg()
            message.header.frame_id = self._parameters.frame_id
        self._publisher.publish(message)
        self.counts['published'] += 1
