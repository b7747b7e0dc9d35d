"""Node `wheels_to_twist`: a controller's wheel velocities drive a robot that takes `cmd_vel`.

It is a process of its own, and stops the robot also where the controller's process hangs or was
killed. A controller node with `command` publishes `cmd_vel` itself.
"""

from __future__ import annotations

from dataclasses import dataclass
import sys

from rclpy.clock import Clock, ClockType
from rclpy.qos import QoSProfile
from spikelane_msgs.msg import WheelVelocities as WheelVelocitiesMessage

from spikelane_sim import topic_names
from spikelane_sim.drive_limiter import BaseParameters
from spikelane_sim.messages import wheels_from_message
from spikelane_sim.nodes.base_drive import BaseDrive
from spikelane_sim.nodes.parameter_node import ParameterNode
from spikelane_sim.nodes.ros_parameters import declare_parameters
from spikelane_sim.nodes.running import run_node
from spikelane_sim.nodes.sole_publishers import SolePublishers
from spikelane_sim.nodes.status_publisher import StatusPublisher
from spikelane_sim.nodes.waiting import publishers_of, WaitingWarnings
from spikelane_sim.parameters import parameter

_STATUS_PERIOD_S = 1.0


@dataclass(frozen=True, kw_only=True)
class WheelsToTwistParameters(BaseParameters):
    """The robot's base, and the type of its commands."""

    use_stamped_vel: bool = parameter(False, 'Publish cmd_vel as TwistStamped instead of Twist.')


class WheelsToTwist(ParameterNode):
    """Publishes a twist for each wheel velocities that come, and stops the robot where none do."""

    def __init__(self) -> None:
        """Declare the parameters, and find out about the robot or begin to wait for that.

        Raises:
            SpikelaneError: A parameter is not allowed, or the URDF does not say what is needed.
        """
        super().__init__('wheels_to_twist')
        self.exit_status = 0
        settings = declare_parameters(self, WheelsToTwistParameters)
        self._drive = BaseDrive(
            self,
            settings,
            topic_names.WHEELS,
            is_stamped=settings.use_stamped_vel,
            on_geometry=lambda text: self.get_logger().info(f'ready: {text}'),
        )
        self._status = StatusPublisher(self, self.get_name())
        self.create_subscription(
            WheelVelocitiesMessage, topic_names.WHEELS, self._on_wheels, QoSProfile(depth=10)
        )
        SolePublishers(self, (topic_names.WHEELS,)).look_regularly()
        self._waiting = WaitingWarnings(self, lambda: self._drive.counts['published'], self._lacks)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_STATUS_PERIOD_S, self._publish_status, clock=steady)

    def halt(self, number: int) -> None:
        """Stop the robot; see `run_node`."""
        del number
        self._drive.halt()

    def destroy_node(self) -> None:
        """Stop the robot, unless a signal has done so."""
        self._drive.halt()
        super().destroy_node()

    def _on_wheels(self, message: WheelVelocitiesMessage) -> None:
        self._drive.drive(wheels_from_message(message))

    def _lacks(self) -> str:
        if self._drive.geometry is None or self._drive.counts['received']:
            return self._drive.lacks()
        count = publishers_of(self, topic_names.WHEELS)
        return f'waiting for {topic_names.WHEELS}; {count} publishers are there'

    def _publish_status(self) -> None:
        is_driving = self._drive.is_driving
        self._status.publish(
            'driving' if is_driving else self._lacks(),
            self._drive.values(),
            is_worrying=not is_driving,
        )


def main() -> None:
    """Run the node."""
    sys.exit(run_node(WheelsToTwist))


if __name__ == '__main__':
    main()
