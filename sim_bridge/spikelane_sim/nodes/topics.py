"""The simulator's topics: what is published after each step, and only to whom it interests."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from event_camera_msgs.msg import EventPacket
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, JointState
from spikelane_msgs.msg import LaneState as LaneStateMessage
from std_msgs.msg import Float64, String
from tf2_msgs.msg import TFMessage

from spikelane_sim import topic_names
from spikelane_sim.contract import LaneState, Observation, RobotState
from spikelane_sim.frame_names import CAMERA_FRAME, WHEEL_JOINTS
from spikelane_sim.nodes import conversions
from spikelane_sim.nodes.kept_publisher import KeptPublisher
from spikelane_sim.nodes.local_topics import CARRIED_TOPICS, LocalTopics
from spikelane_sim.nodes.meeting import LATCHED
from spikelane_sim.robots.sizing import sized_urdf
from spikelane_sim.simulator import Simulator


class SimulatorTopics:
    """Publishes an observation on the topics that somebody subscribes to.

    Messages are made once and refilled. Event packets are published last: whoever has the packet
    of a step can count on the rest of the step having been sent. A subscriber that is met too late
    for a topic of an observation is sent that topic afterwards.

    Attributes:
        steps: Publishers of one message an observation, in the order of publishing.
        latched: Publishers of what does not change.
    """

    def __init__(
        self,
        node: Node,
        simulator: Simulator,
        encoding: str,
        depth: int,
        on_match: Callable[[], None],
        local: LocalTopics | None = None,
    ) -> None:
        """Create the publishers.

        Args:
            node: The node that publishes.
            simulator: Where the robot's state comes from.
            encoding: Encoding of the event packets.
            depth: Messages kept for a subscriber that is late.
            on_match: Called when a subscriber to a topic of an observation is met or lost.
            local: Carries observations to nodes of this process; None: there are none.
        """
        self._simulator = simulator
        self._encoding = encoding
        self._packets = 0
        self._make_messages(simulator)
        tf_static = KeptPublisher(node, TFMessage, topic_names.TF_STATIC, LATCHED, on_match)
        description = KeptPublisher(node, String, topic_names.ROBOT_DESCRIPTION, LATCHED, on_match)
        self.latched = (tf_static, description)
        topics: tuple[tuple[type, str, Callable[[Observation], Any]], ...] = (
            (Clock, topic_names.CLOCK, self._fill_clock),
            (TFMessage, topic_names.TF, self._fill_tf),
            (Odometry, topic_names.ODOMETRY, self._fill_odometry),
            (JointState, topic_names.JOINT_STATES, self._fill_joint_state),
            (Float64, topic_names.LANE_DISTANCE, self._fill_distance),
            (CameraInfo, topic_names.CAMERA_INFO, self._fill_camera_info),
            (Image, topic_names.IMAGE, self._fill_image),
            (LaneStateMessage, topic_names.LANE_STATE, self._fill_lane_state),
            (EventPacket, topic_names.EVENTS, self._fill_packet),
        )
        qos = QoSProfile(depth=depth)
        carried = dict.fromkeys(CARRIED_TOPICS, local)
        self._topics = tuple(
            (KeptPublisher(node, kind, topic, qos, on_match, carried.get(topic)), fill)
            for kind, topic, fill in topics
        )
        self.steps = tuple(publisher for publisher, _ in self._topics)
        tf_static.publish(TFMessage(transforms=[conversions.camera_transform(simulator.camera)]))
        description.publish(String(data=sized_urdf(simulator.parameters.robot)))

    @property
    def event_subscribers(self) -> int:
        """Subscribers that the event packets reach."""
        return self.steps[-1].subscribers

    @property
    def is_missed(self) -> bool:
        """Whether a subscriber lacks some topic of the last observation."""
        return any(publisher.is_missed for publisher, _ in self._topics)

    @property
    def packets(self) -> int:
        """Event packets published, or that would have been had somebody subscribed."""
        return self._packets

    def publish(self, observation: Observation, is_new: bool = True) -> None:
        """Publish an observation; one that is not new goes where it was missed."""
        self._packets += is_new
        for publisher, fill in self._topics:
            if is_new:
                publisher.send(partial(fill, observation))
            else:
                publisher.send_again(partial(fill, observation))

    def _make_messages(self, simulator: Simulator) -> None:
        camera = simulator.parameters.camera
        self._packet = EventPacket(width=camera.width, height=camera.height)
        self._packet.header.frame_id = CAMERA_FRAME
        self._clock = Clock()
        self._transform = TransformStamped(child_frame_id=conversions.BODY_FRAME)
        self._transform.header.frame_id = conversions.WORLD_FRAME
        self._odometry = Odometry(child_frame_id=conversions.BODY_FRAME)
        self._odometry.header.frame_id = conversions.WORLD_FRAME
        self._joints = JointState(name=list(WHEEL_JOINTS))
        self._camera_info = conversions.camera_info(simulator.camera)
        self._image = Image(width=camera.width, height=camera.height, encoding='bgr8')
        self._image.step = 3 * camera.width
        self._image.header.frame_id = CAMERA_FRAME
        self._lane = LaneStateMessage()
        self._lane.header.frame_id = conversions.WORLD_FRAME

    @property
    def _robot(self) -> RobotState:
        return self._simulator.robot_state

    def _fill_packet(self, observation: Observation) -> EventPacket:
        conversions.fill_event_packet(
            self._packet,
            observation.events,
            observation.stamp_ns,
            self._packets - 1,
            self._encoding,
            self._simulator.parameters.period_ns,
        )
        return self._packet

    def _fill_clock(self, observation: Observation) -> Clock:
        self._clock.clock = conversions.to_time(observation.stamp_ns)
        return self._clock

    def _fill_tf(self, observation: Observation) -> TFMessage:
        conversions.fill_body_transform(self._transform, self._robot, observation.stamp_ns)
        return TFMessage(transforms=[self._transform])

    def _fill_odometry(self, observation: Observation) -> Odometry:
        conversions.fill_odometry(self._odometry, self._robot, observation.stamp_ns)
        return self._odometry

    def _fill_joint_state(self, observation: Observation) -> JointState:
        conversions.fill_joint_state(self._joints, self._robot, observation.stamp_ns)
        return self._joints

    def _fill_distance(self, observation: Observation) -> Float64:
        return Float64(data=_lane(observation).distance_m)

    def _fill_camera_info(self, observation: Observation) -> CameraInfo:
        self._camera_info.header.stamp = conversions.to_time(observation.stamp_ns)
        return self._camera_info

    def _fill_image(self, observation: Observation) -> Image:
        conversions.fill_event_image(self._image, observation.events, observation.stamp_ns)
        return self._image

    def _fill_lane_state(self, observation: Observation) -> LaneStateMessage:
        conversions.fill_lane_state(self._lane, _lane(observation), observation.stamp_ns)
        return self._lane


def _lane(observation: Observation) -> LaneState:
    assert observation.lane is not None  # the simulator always knows it
    return observation.lane
