"""The simulator's topics: what is published after each step, and only to whom it interests."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from event_camera_msgs.msg import EventPacket
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, JointState
from spikelane_msgs.msg import LaneState as LaneStateMessage
from std_msgs.msg import Float64, String
from tf2_msgs.msg import TFMessage

from spikelane_sim import topic_names
from spikelane_sim.contract import LaneState, Observation, RobotState
from spikelane_sim.nodes import conversions
from spikelane_sim.nodes.audience import Audience
from spikelane_sim.robots.description import URDF_PATH
from spikelane_sim.simulator import Simulator

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class SimulatorTopics:
    """Publishes an observation on the topics that somebody subscribes to.

    Messages are made once and refilled. Event packets are published last: whoever has the packet
    of a step can count on the rest of the step having been sent. Their publisher is also made
    last, so that a subscriber matched to it is matched to all.
    """

    def __init__(
        self,
        node: Node,
        simulator: Simulator,
        encoding: str,
        depth: int,
        on_match: Callable[[bool], None],
    ) -> None:
        """Create the publishers.

        Args:
            node: The node that publishes.
            simulator: Where the robot's state comes from.
            encoding: Encoding of the event packets.
            depth: Messages kept for a subscriber that is late.
            on_match: Called when a subscriber to the event packets is met or lost, with whether
                there are some that the last packet has not reached.
        """
        self._simulator = simulator
        self._encoding = encoding
        self._packets = 0
        self._sent: dict[Publisher, int] = {}
        self._audience = Audience()
        self._make_messages(simulator)
        self._tf_static = node.create_publisher(TFMessage, topic_names.TF_STATIC, LATCHED)
        self._description = node.create_publisher(String, 'robot_description', LATCHED)
        publish = partial(self._publisher, node, QoSProfile(depth=depth))
        self._optional = (
            (publish(Clock, topic_names.CLOCK), self._fill_clock),
            (publish(TFMessage, topic_names.TF), self._fill_tf),
            (publish(Odometry, topic_names.ODOMETRY), self._fill_odometry),
            (publish(JointState, topic_names.JOINT_STATES), self._fill_joint_state),
            (publish(Float64, topic_names.LANE_DISTANCE), self._fill_distance),
            (publish(CameraInfo, topic_names.CAMERA_INFO), self._fill_camera_info),
            (publish(Image, topic_names.IMAGE), self._fill_image),
            (publish(LaneStateMessage, topic_names.LANE_STATE), self._fill_lane_state),
        )
        self._events = node.create_publisher(
            EventPacket,
            topic_names.EVENTS,
            QoSProfile(depth=depth),
            event_callbacks=PublisherEventCallbacks(
                matched=lambda _: on_match(self._audience.has_grown(self.event_subscribers))
            ),
        )
        self._tf_static.publish(
            TFMessage(transforms=[conversions.camera_transform(simulator.camera)])
        )
        self._description.publish(String(data=URDF_PATH.read_text(encoding='utf-8')))

    @property
    def event_subscribers(self) -> int:
        """Subscribers that the event packets reach."""
        return int(self._events.get_subscription_count())

    @property
    def packets(self) -> int:
        """Event packets published."""
        return self._packets

    def sent(self) -> dict[str, int]:
        """Return how many messages were published on each topic of a step."""
        return {publisher.topic_name: count for publisher, count in self._sent.items()}

    def publish(self, observation: Observation, is_new: bool = True) -> None:
        """Publish an observation; `is_new` is false where it has been published before."""
        for publisher, fill in self._optional:
            if publisher.get_subscription_count():
                self._send(publisher, fill(observation))
        self._packets += is_new
        conversions.fill_event_packet(
            self._packet,
            observation.events,
            observation.stamp_ns,
            self._packets - 1,
            self._encoding,
        )
        self._audience.reach(self.event_subscribers)
        self._send(self._events, self._packet)

    def _send(self, publisher: Publisher, message: Any) -> None:
        self._sent[publisher] = self._sent.get(publisher, 0) + 1
        publisher.publish(message)

    def _make_messages(self, simulator: Simulator) -> None:
        camera = simulator.parameters.camera
        self._packet = EventPacket(width=camera.width, height=camera.height)
        self._packet.header.frame_id = conversions.CAMERA_FRAME
        self._clock = Clock()
        self._transform = TransformStamped(child_frame_id=conversions.BODY_FRAME)
        self._transform.header.frame_id = conversions.WORLD_FRAME
        self._odometry = Odometry(child_frame_id=conversions.BODY_FRAME)
        self._odometry.header.frame_id = conversions.WORLD_FRAME
        self._joints = JointState(name=list(conversions.WHEEL_JOINTS))
        self._camera_info = conversions.camera_info(simulator.camera)
        self._image = Image(width=camera.width, height=camera.height, encoding='bgr8')
        self._image.step = 3 * camera.width
        self._image.header.frame_id = conversions.CAMERA_FRAME
        self._lane = LaneStateMessage()
        self._lane.header.frame_id = conversions.WORLD_FRAME

    @staticmethod
    def _publisher(node: Node, qos: QoSProfile, kind: type, topic: str) -> Any:
        return node.create_publisher(kind, topic, qos)

    @property
    def _robot(self) -> RobotState:
        return self._simulator.robot_state

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
