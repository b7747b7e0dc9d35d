"""The topics that drive the robot, and the nodes that publish on them.

A robot is meant to have one publisher of commands. Where there are several, their commands mix
and the drive is nobody's: they are named once a second for as long as it goes on.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from spikelane_msgs.msg import WheelVelocities as WheelVelocitiesMessage
from std_msgs.msg import Float64MultiArray

from spikelane_sim import messages, topic_names
from spikelane_sim.contract import WheelVelocities
from spikelane_sim.errors import MessageError
from spikelane_sim.frame_names import WHEEL_JOINTS
from spikelane_sim.nodes import conversions
from spikelane_sim.nodes.direct import DirectSubscriptions
from spikelane_sim.robots import RobotParameters
from spikelane_sim.stepper import Stepper


class Commands:
    """Takes commands to the stepper: in lockstep `wheel_velocities` alone."""

    def __init__(
        self,
        node: Node,
        direct: DirectSubscriptions,
        robot: RobotParameters,
        stepper: Stepper,
        notice: Callable[[], None],
    ) -> None:
        """Subscribe to `wheel_velocities`; nothing is taken before `start`.

        Args:
            node: The node that subscribes.
            direct: Its subscriptions on the lockstep path.
            robot: To know what a twist means for the wheels.
            stepper: Receives the commands.
            notice: Called after each answer in lockstep.
        """
        self._node = node
        self._robot = robot
        self._stepper = stepper
        self._notice = notice
        self._direct = direct
        self._direct.subscribe(
            WheelVelocitiesMessage, topic_names.WHEELS, self._on_wheels, QoSProfile(depth=10)
        )
        self._invalid = 0
        self._ignored = 0  # at the last report
        self._taken: set[str] = set()  # topics that commands came on since then

    def take_usual(self, *, is_stamped: bool) -> None:
        """Subscribe to the usual topics of a robot too.

        Args:
            is_stamped: Whether `cmd_vel` is a TwistStamped instead of a Twist.
        """
        self._node.create_subscription(
            Float64MultiArray, topic_names.WHEEL_ARRAY, self._on_array, 10
        )
        kind = TwistStamped if is_stamped else Twist
        self._node.create_subscription(kind, topic_names.TWIST, self._on_twist, 10)

    def start(self) -> None:
        """Begin to take commands."""
        self._direct.start()

    def stop(self) -> None:
        """Take no more; returns when the one at work has ended."""
        self._direct.stop()

    @property
    def refused(self) -> int:
        """Messages that were not taken because of their content."""
        return self._direct.refused + self._invalid

    def report(self) -> list[str]:
        """Warn where several publishers command the robot; to be called once a second.

        Returns:
            The publishers whose commands have mixed since the last call, each as
            `/node on /topic`; none where one publisher's commands were taken as they came.
        """
        ignored, taken = self._ignored_since_report()
        # In lockstep the answer that comes second is ignored, in real time it replaces the first.
        is_mixed = ignored > 0 if self._stepper.is_lockstep else bool(taken)
        publishers = self._publishers(taken) if is_mixed else []
        if len(publishers) < 2:
            return []
        named = ', '.join(
            name if count == 1 else f'{name} ({count} publishers)'
            for name, count in sorted(Counter(publishers).items())
        )
        what = f'{ignored} commands were ignored'
        if not self._stepper.is_lockstep:
            what = 'each command replaces the one before'
        self._node.get_logger().warning(
            f'commands: expected one publisher, got {len(publishers)}: {named}; {what}'
        )
        return publishers

    def _ignored_since_report(self) -> tuple[int, set[str]]:
        """Return how many commands were ignored, and the topics that commands came on."""
        ignored = self._stepper.ignored_commands - self._ignored
        self._ignored += ignored
        taken, self._taken = self._taken, set()
        return ignored, taken

    def _publishers(self, topics: Collection[str]) -> list[str]:
        return [
            f'{each.node_namespace.rstrip("/")}/{each.node_name} on '
            f'{self._node.resolve_topic_name(topic)}'
            for topic in sorted(topics)
            for each in self._node.get_publishers_info_by_topic(topic)
        ]

    def _on_wheels(self, message: WheelVelocitiesMessage) -> None:
        stamp_ns = messages.to_stamp_ns(message.header.stamp)
        self._take(topic_names.WHEELS, stamp_ns, messages.wheels_from_message(message))
        self._notice()

    def _on_array(self, message: Float64MultiArray) -> None:
        if len(message.data) == len(WHEEL_JOINTS):
            self._take(topic_names.WHEEL_ARRAY, None, WheelVelocities(*message.data))
            return
        self._refuse(
            f'{topic_names.WHEEL_ARRAY}: expected [left, right] in rad/s, '
            f'got {len(message.data)} values'
        )

    def _on_twist(self, message: Twist | TwistStamped) -> None:
        twist = message
        if isinstance(message, TwistStamped):
            twist = message.twist
            try:
                messages.to_stamp_ns(message.header.stamp)
            except MessageError as error:
                self._refuse(f'{topic_names.TWIST}: {error}')
                return
        robot = self._robot
        wheels = conversions.wheels_from_twist(twist, robot.wheel_radius_m, robot.track_m)
        self._take(topic_names.TWIST, None, wheels)

    def _take(self, topic: str, stamp_ns: int | None, wheels: WheelVelocities) -> None:
        self._taken.add(topic)
        self._stepper.command(stamp_ns, wheels)

    def _refuse(self, reason: str) -> None:
        self._invalid += 1
        self._node.get_logger().error(f'{reason}; refused', throttle_duration_sec=1.0)
