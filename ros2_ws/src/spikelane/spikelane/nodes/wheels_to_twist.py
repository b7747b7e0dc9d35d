"""Node `wheels_to_twist`: a controller's wheel velocities drive a robot that takes `cmd_vel`.

The robot must stop where nobody drives it: when wheel velocities fail to come, when they are not
finite, and when the node ends, it is told so. A node that is killed can tell nothing: the robot's
base needs a timeout of its own, as all that take `cmd_vel` have.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from pathlib import Path
import sys
import threading

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from spikelane_msgs.msg import WheelVelocities as WheelVelocitiesMessage
from std_msgs.msg import String

from spikelane_sim import topic_names
from spikelane_sim.errors import ParameterError
from spikelane_sim.frame_names import WHEEL_JOINTS
from spikelane_sim.messages import wheels_from_message
from spikelane_sim.nodes.meeting import LATCHED
from spikelane_sim.nodes.ros_parameters import declare_parameters
from spikelane_sim.nodes.running import run_node
from spikelane_sim.nodes.sole_publishers import SolePublishers
from spikelane_sim.nodes.status_publisher import StatusPublisher
from spikelane_sim.nodes.waiting import publishers_of, WaitingWarnings
from spikelane_sim.parameters import parameter, Parameters
from spikelane_sim.robots.differential_drive import BodyVelocity, DriveGeometry, read_geometry

_QOS = QoSProfile(depth=10)
_LOOK_PERIOD_S = 0.05
_STATUS_PERIOD_S = 1.0
#: A robot may be told best-effort; after these the topic is left to others that may drive.
_STOPS = 3
_STILL = BodyVelocity(0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class WheelsToTwistParameters(Parameters):
    """The robot, the type of its commands, and its limits."""

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
    use_stamped_vel: bool = parameter(False, 'Publish cmd_vel as TwistStamped instead of Twist.')
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
    timeout_s: float = parameter(
        0.5,
        'The robot is stopped when no wheel velocities have come for this time, which is '
        'simulation time if use_sim_time is true.',
        unit='s',
        low=0.05,
        high=3600.0,
    )


class WheelsToTwist(Node):
    """Publishes a twist for each wheel velocities that come, and stops the robot where none do."""

    def __init__(self) -> None:
        """Declare the parameters, and find out about the robot or begin to wait for that.

        Raises:
            SpikelaneError: A parameter is not allowed, or the URDF does not say what is needed.
        """
        super().__init__('wheels_to_twist')
        self.exit_status = 0
        self._settings = settings = declare_parameters(self, WheelsToTwistParameters)
        # Messages come in one thread, the signal that ends the node in another.
        self._lock = threading.Lock()
        self._is_halted = False
        self._stops_left = 0
        self._is_silent = False
        self._heard_ns: int | None = None  # when the last wheel velocities came
        self._last = _STILL
        self._counts = dict.fromkeys(
            ('received', 'published', 'limited', 'not_finite', 'ignored', 'timeouts'), 0
        )
        kind = TwistStamped if settings.use_stamped_vel else Twist
        self._publisher = self.create_publisher(kind, topic_names.TWIST, _QOS)
        self._status = StatusPublisher(self, self.get_name())
        # Wall time may be set; simulation time may stand still, and the robot with it.
        is_simulated = bool(self.get_parameter('use_sim_time').value)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._clock = self.get_clock() if is_simulated else steady
        self._geometry = self._find_geometry()
        self.create_subscription(WheelVelocitiesMessage, topic_names.WHEELS, self._on_wheels, _QOS)
        SolePublishers(self, (topic_names.WHEELS,)).look_regularly()
        self._waiting = WaitingWarnings(self, lambda: self._counts['published'], self._lacks)
        self.create_timer(_LOOK_PERIOD_S, self._look, clock=steady)
        self.create_timer(_STATUS_PERIOD_S, self._publish_status, clock=steady)

    def halt(self, number: int) -> None:
        """Stop the robot; see `run_node`."""
        del number
        with self._lock:
            self._is_halted = True
            self._publish(_STILL)

    def destroy_node(self) -> None:
        """Stop the robot, unless a signal has done so."""
        with self._lock:
            if not self._is_halted and self.context.ok():
                self._publish(_STILL)
            self._is_halted = True
        super().destroy_node()

    def _find_geometry(self) -> DriveGeometry | None:
        """Return what is known of the robot; where it is not enough, subscribe to what is."""
        settings = self._settings
        if settings.wheel_radius_m and settings.track_m:
            return self._told(DriveGeometry(settings.wheel_radius_m, settings.track_m))
        if settings.urdf_file:
            try:
                text = Path(settings.urdf_file).read_text(encoding='utf-8')
                return self._told(self._read(text))
            except OSError as error:
                raise ParameterError(
                    f'urdf_file: {settings.urdf_file}: {error.strerror}'
                ) from None
            except (ParameterError, UnicodeDecodeError) as error:
                raise ParameterError(f'urdf_file: {settings.urdf_file}: {error}') from None
        self.create_subscription(
            String, topic_names.ROBOT_DESCRIPTION, self._on_description, LATCHED
        )
        return None

    def _read(self, urdf: str) -> DriveGeometry:
        """Return what a URDF says, where no parameter does."""
        settings = self._settings
        found = read_geometry(urdf, settings.left_joint, settings.right_joint)
        return DriveGeometry(
            settings.wheel_radius_m or found.wheel_radius_m, settings.track_m or found.track_m
        )

    def _told(self, geometry: DriveGeometry) -> DriveGeometry:
        """Return the geometry, which is logged: the node is ready."""
        kind = 'TwistStamped' if self._settings.use_stamped_vel else 'Twist'
        self.get_logger().info(
            f'ready: {topic_names.WHEELS} to {topic_names.TWIST} ({kind}), wheel radius '
            f'{geometry.wheel_radius_m:g} m, track {geometry.track_m:g} m, at most '
            f'{self._settings.max_linear_m_s:g} m/s and {self._settings.max_angular_rad_s:g} rad/s'
        )
        return geometry

    def _on_description(self, message: String) -> None:
        try:
            geometry = self._read(message.data)
        except ParameterError as error:
            self.get_logger().error(f'{topic_names.ROBOT_DESCRIPTION}: {error}; refused')
            return
        if geometry != self._geometry:
            self._geometry = self._told(geometry)

    def _on_wheels(self, message: WheelVelocitiesMessage) -> None:
        with self._lock:
            self._counts['received'] += 1
            self._heard_ns = self._clock.now().nanoseconds
            if self._is_silent:
                self.get_logger().info(f'{topic_names.WHEELS}: they come again')
            self._is_silent = False
            if self._geometry is None:
                self._counts['ignored'] += 1
            elif not self._is_halted:
                self._publish(self._wanted(self._geometry, message))

    def _wanted(self, geometry: DriveGeometry, message: WheelVelocitiesMessage) -> BodyVelocity:
        """Return how the body is to move, within the limits."""
        settings = self._settings
        wanted = geometry.body_velocity(wheels_from_message(message))
        if not all(map(math.isfinite, wanted)):
            self._counts['not_finite'] += 1
            self.get_logger().error(
                f'{topic_names.WHEELS}: expected finite rad/s, got {message.left} and '
                f'{message.right}; the robot is stopped',
                throttle_duration_sec=1.0,
            )
            return _STILL
        limited = wanted.limited(settings.max_linear_m_s, settings.max_angular_rad_s)
        if limited != wanted:
            self._counts['limited'] += 1
            self.get_logger().warning(
                f'{topic_names.WHEELS}: they mean {wanted.forward_m_s:.3g} m/s and '
                f'{wanted.turn_rad_s:.3g} rad/s; limited',
                throttle_duration_sec=1.0,
            )
        return limited

    def _publish(self, velocity: BodyVelocity) -> None:
        twist = Twist()
        twist.linear.x, twist.angular.z = velocity
        message = twist
        if self._settings.use_stamped_vel:
            message = TwistStamped(twist=twist)
            message.header.stamp = self.get_clock().now().to_msg()
            message.header.frame_id = self._settings.frame_id
        self._publisher.publish(message)
        self._last = velocity
        self._counts['published'] += 1

    def _look(self) -> None:
        """Stop the robot where nobody has driven it for too long."""
        with self._lock:
            if self._heard_ns is None or self._is_halted:
                return
            now_ns = self._clock.now().nanoseconds
            self._heard_ns = min(self._heard_ns, now_ns)  # simulation time may be set back
            if not self._is_silent and now_ns - self._heard_ns > self._settings.timeout_s * 1e9:
                self._is_silent, self._stops_left = True, _STOPS
                self._counts['timeouts'] += 1
                self.get_logger().warning(
                    f'{topic_names.WHEELS}: none came for {self._settings.timeout_s:g} s; '
                    'the robot is stopped'
                )
            if self._is_silent and self._stops_left:
                self._stops_left -= 1
                self._publish(_STILL)

    def _lacks(self) -> str:
        if self._geometry is None:
            topic = topic_names.ROBOT_DESCRIPTION
            count = publishers_of(self, topic)
            return (
                f'waiting for {topic}, which says how large the wheels are; {count} publishers '
                'are there (or give wheel_radius_m and track_m, or urdf_file)'
            )
        count = publishers_of(self, topic_names.WHEELS)
        return f'waiting for {topic_names.WHEELS}; {count} publishers are there'

    def _publish_status(self) -> None:
        with self._lock:
            geometry = self._geometry
            is_driving = geometry is not None and self._heard_ns is not None
            is_driving = is_driving and not self._is_silent
            values: dict[str, object] = {
                **self._counts,
                'linear_m_s': self._last.forward_m_s,
                'angular_rad_s': self._last.turn_rad_s,
            }
        if geometry is not None:
            values |= geometry._asdict()
        self._status.publish(
            'driving' if is_driving else self._lacks(), values, is_worrying=not is_driving
        )


def main() -> None:
    """Run the node."""
    sys.exit(run_node(WheelsToTwist))


if __name__ == '__main__':
    main()
