"""Node `lane_from_pose`: where a real robot is on the lane of a known course, from its pose.

The pose comes as odometry, or as a transform that somebody else publishes, such as motion capture
or a detector of AprilTags. Odometry drifts: each time a person puts the robot at the start of its
lane, `~/place` tells the node so.
"""

from __future__ import annotations

from dataclasses import dataclass
import sys

from nav_msgs.msg import Odometry
import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from spikelane_msgs.msg import LaneState as LaneStateMessage
from std_msgs.msg import Float64
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from spikelane_sim import topic_names
from spikelane_sim.course import load_course, Pose
from spikelane_sim.errors import MessageError, SpikelaneError
from spikelane_sim.lane_tracker import LaneTracker
from spikelane_sim.messages import to_stamp_ns
from spikelane_sim.nodes import conversions
from spikelane_sim.nodes.ros_parameters import declare_parameters
from spikelane_sim.nodes.running import run_node
from spikelane_sim.nodes.waiting import WaitingWarnings
from spikelane_sim.parameters import parameter, Parameters
from spikelane_sim.transform_tree import Transform, TransformTree

#: Who publishes does so best-effort or reliably; a best-effort subscription receives both.
_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
_STATIC = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@dataclass(frozen=True, kw_only=True)
class LaneFromPoseParameters(Parameters):
    """The course, and where the pose comes from."""

    course: str = parameter('scenario_1', "Shipped course, or path of a course's file.")
    lane: str = parameter('', "Lane that the robot drives on; empty: the course's first.")
    source: str = parameter(
        'messages',
        'Where the pose of the robot comes from: nav_msgs/Odometry on odometry (messages), or '
        'the transform from world_frame to robot_frame (transforms).',
        choices=('messages', 'transforms'),
    )
    world_frame: str = parameter(
        'map', "Frame of the course, as its file has it, where transforms are the pose's source."
    )
    robot_frame: str = parameter('base_link', "Frame of the robot's body.")


class LaneFromPose(Node):
    """Publishes a lane state and the lane distance for each pose."""

    def __init__(self) -> None:
        """Declare the parameters, load the course and subscribe.

        Raises:
            SpikelaneError: A parameter is not allowed, or there is no such course or lane.
        """
        super().__init__('lane_from_pose')
        self.exit_status = 0
        self._settings = settings = declare_parameters(self, LaneFromPoseParameters)
        has_frame = settings.source == 'transforms'
        self._tracker = LaneTracker(
            load_course(settings.course), settings.lane, is_placed=has_frame
        )
        self._pose: Pose | None = None
        self._published = 0
        self._state = self.create_publisher(LaneStateMessage, topic_names.LANE_STATE, 10)
        self._distance = self.create_publisher(Float64, topic_names.LANE_DISTANCE, 10)
        self._tree = TransformTree()
        if has_frame:
            self.create_subscription(TFMessage, topic_names.TF, self._on_transforms, _QOS)
            self.create_subscription(
                TFMessage, topic_names.TF_STATIC, self._on_transforms, _STATIC
            )
        else:
            self.create_subscription(Odometry, topic_names.ROBOT_ODOMETRY, self._on_odometry, _QOS)
        self.create_service(Trigger, '~/place', self._place)
        self._waiting = WaitingWarnings(self, lambda: self._published, self._lacks)
        self.get_logger().info(f'ready: {settings.course} from {settings.source}')

    def _on_odometry(self, message: Odometry) -> None:
        turn = message.pose.pose.orientation
        place = message.pose.pose.position
        pose = Pose(place.x, place.y, conversions.heading_of(turn))
        try:
            self._publish(pose, to_stamp_ns(message.header.stamp))
        except (MessageError, SpikelaneError) as error:
            self._refuse(str(error))

    def _on_transforms(self, message: TFMessage) -> None:
        stamp_ns = None
        try:
            for each in message.transforms:
                place, turn = each.transform.translation, each.transform.rotation
                self._tree.add(
                    each.header.frame_id,
                    each.child_frame_id,
                    Transform((place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w)),
                )
                stamp_ns = to_stamp_ns(each.header.stamp)
            matrix = self._tree.find(self._settings.world_frame, self._settings.robot_frame)
            if matrix is not None and stamp_ns is not None:
                self._publish(_pose_of(matrix), stamp_ns)
        except (MessageError, SpikelaneError) as error:
            self._refuse(str(error))

    def _publish(self, pose: Pose, stamp_ns: int) -> None:
        state = self._tracker.locate(pose)
        self._pose = pose
        if state is None:
            return
        message = LaneStateMessage()
        conversions.fill_lane_state(message, state, stamp_ns)
        self._state.publish(message)
        self._distance.publish(Float64(data=state.distance_m))
        self._published += 1

    def _place(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Take it that the robot stands at the start of its lane."""
        del request
        if self._pose is None:
            response.message = 'pose: expected one before the robot is placed, got none yet'
            return response
        self._tracker.place(self._pose)
        response.success, response.message = True, 'the robot is at the start of its lane'
        return response

    def _refuse(self, reason: str) -> None:
        self.get_logger().error(f'{reason}; refused', throttle_duration_sec=1.0)

    def _lacks(self) -> str:
        if self._settings.source == 'transforms':
            frames = ', '.join(self._tree.frames) or 'none'
            return (
                f'waiting for a transform from {self._settings.world_frame} to '
                f'{self._settings.robot_frame}; frames that were received: {frames}'
            )
        if self._pose is None:
            return f'waiting for {topic_names.ROBOT_ODOMETRY}'
        if self._tracker.is_placed:
            return f'{topic_names.ROBOT_ODOMETRY} no longer comes'
        service = self.resolve_service_name('~/place')
        return f'waiting for the robot: put it at the start of its lane and call {service}'


def _pose_of(matrix: NDArray[np.float64]) -> Pose:
    return Pose(
        float(matrix[0, 3]), float(matrix[1, 3]), float(np.arctan2(matrix[1, 0], matrix[0, 0]))
    )


def main() -> None:
    """Run the node."""
    sys.exit(run_node(LaneFromPose))


if __name__ == '__main__':
    main()
