"""What a training on a real robot has instead of a simulator: its lane, and who puts it back."""

from __future__ import annotations

from collections.abc import Callable
import threading

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from spikelane_msgs.msg import LaneState as LaneStateMessage
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from spikelane_controllers.learning.robot_episodes import EpisodeError, RobotEpisodes
from spikelane_sim import messages, topic_names
from spikelane_sim.contract import LaneState
from spikelane_sim.errors import MessageError
from spikelane_sim.nodes.base_drive import BaseDrive

SERVICE = '~/begin_episode'
#: Topics that say where the robot is on its lane, by the value of `lane_source`.
LANE_TOPICS = {'distance': topic_names.LANE_DISTANCE, 'state': topic_names.LANE_STATE}

#: A best-effort subscription receives from whoever publishes, and only the latest matters.
_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


class RobotLane:
    """Receives where the robot is, and serves the person who puts it back.

    The base stands between episodes. While it may not drive, as with the dead-man switch
    released, the episode pauses: who carries the robot must not teach it anything.
    """

    def __init__(
        self,
        node: Node,
        source: str,
        lane: str,
        episodes: RobotEpisodes,
        base: BaseDrive,
        lock: threading.Lock,
        on_end: Callable[[LaneState], None],
    ) -> None:
        """Subscribe, serve, and let the base stand.

        Args:
            node: The controller node.
            source: Of LANE_TOPICS.
            lane: Name of the lane, where the source does not tell it.
            episodes: Makes lane states.
            base: Is held between episodes.
            lock: Held while the controller steps.
            on_end: Called with the last lane state of an episode that a person has ended.
        """
        self._node, self._topic, self._lane = node, LANE_TOPICS[source], lane
        self._episodes, self._base, self._lock, self._on_end = episodes, base, lock, on_end
        if source == 'state':
            node.create_subscription(LaneStateMessage, self._topic, self._on_state, _QOS)
        else:
            node.create_subscription(Float64, self._topic, self._on_distance, _QOS)
        node.create_service(Trigger, SERVICE, self._begin)
        self._hold('no episode has begun')

    def next(self) -> LaneState | None:
        """Return the lane state of a step; None where the robot does not drive for learning."""
        if not (self._episodes.is_running and self._base.may_drive):
            return None
        state = self._episodes.next()
        if state is not None and state.terminated:
            text = f'episode {state.episode} is over after {state.step} steps: {state.reason}'
            self._node.get_logger().info(f'{text}, {state.distance_m:.3f} m')
            self._hold(text)
        return state

    def _hold(self, why: str) -> None:
        service = self._node.resolve_service_name(SERVICE)
        self._base.hold(f'{why}; put the robot on its lane and call {service}', 'it drives again')

    def _on_state(self, message: LaneStateMessage) -> None:
        try:
            state = messages.lane_state_from_message(message)
        except MessageError as error:
            self._refuse(str(error))
            return
        self._base.hear(self._topic)
        with self._lock:
            self._episodes.hear(state)

    def _on_distance(self, message: Float64) -> None:
        try:
            with self._lock:
                self._episodes.hear_distance(self._lane, message.data)
        except EpisodeError as error:
            self._refuse(str(error))
            return
        self._base.hear(self._topic)

    def _refuse(self, reason: str) -> None:
        self._node.get_logger().error(
            f'{self._topic}: {reason}; refused', throttle_duration_sec=1.0
        )

    def _begin(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Begin an episode, since the robot was put back; one that runs ends."""
        del request
        try:
            if self._base.is_silent(self._topic):
                raise EpisodeError(f'{self._topic}: expected one within the timeout, got none')
            with self._lock:
                episode, ended = self._episodes.begin()
                if ended is not None:
                    self._on_end(ended)
        except EpisodeError as error:
            response.message = str(error)
            return response
        self._base.release()
        response.success, response.message = True, f'episode {episode} begins'
        self._node.get_logger().info(response.message)
        return response
