"""What every controller node is: observations in, wheel velocities out.

An observation is an event packet and the lane state of the same stamp. Each is answered once; the
answer carries its stamp and is sent again when a subscriber joins or the observation comes again,
so that whoever starts first, nothing waits for what was sent too early.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
import threading
from typing import NamedTuple

from event_camera_msgs.msg import EventPacket
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile
from spikelane_msgs.msg import ControllerState, LaneState, WheelVelocities

from spikelane_controllers.registry import controller_class
from spikelane_sim.contract import Controller, controller_rng, Observation, STEP_NS
from spikelane_sim.errors import PacketError
from spikelane_sim.events import no_events
from spikelane_sim.nodes import conversions
from spikelane_sim.nodes.direct import DirectSubscriptions
from spikelane_sim.nodes.pairing import StampPairs
from spikelane_sim.nodes.ros_parameters import declare_parameters
from spikelane_sim.parameters import parameter, Parameters

RELIABLE_10 = QoSProfile(depth=10)


@dataclass(frozen=True, kw_only=True)
class ControllerNodeParameters(Parameters):
    """How a controller takes part in a ROS graph."""

    seed: int = parameter(0, "Seed of the controller's randomness.", low=0)
    use_lane_state: bool = parameter(
        True, 'Wait for lane/state with each event packet; false for a real camera.'
    )
    history_depth: int = parameter(
        10, 'Messages kept for a subscriber that is late; more cost time.', low=1, high=10**6
    )
    wait_for_subscribers: int = parameter(
        0, 'Subscribers wheel_velocities must have before an answer is published.', low=0
    )


class _Identity(NamedTuple):
    """Tells an observation that comes again from another at the same time after a reset."""

    stamp_ns: int
    sequence: int


class _Episode(NamedTuple):
    """Tells one episode from the next."""

    number: int
    last_step: int


class ControllerNode(Node):
    """Hosts one controller of the registry."""

    def __init__(self, name: str) -> None:
        """Declare the parameters and make the controller.

        Raises:
            SpikelaneError: A parameter is not allowed.
        """
        super().__init__(name)
        self.exit_status = 0
        self._settings = declare_parameters(self, ControllerNodeParameters)
        self._driver: Controller = self._make_driver(name)
        self._controller: Controller = self._wrap_driver(name, self._driver)
        self._controller.reset(controller_rng(self._settings.seed, 0))
        self._episode: _Episode | None = None
        self._answered: _Identity | None = None
        self._answer = WheelVelocities()
        # Observations come in one thread, subscribers join in another.
        self._lock = threading.Lock()
        self._state = ControllerState(
            controller=name, neurons=list(getattr(self._driver, 'neurons', ()))
        )
        # The wheel velocities' publisher is made last: who is matched to it is matched to both.
        kept = QoSProfile(depth=self._settings.history_depth)
        self._states = self.create_publisher(ControllerState, 'controller/state', kept)
        self._wheels = self.create_publisher(
            WheelVelocities,
            'wheel_velocities',
            kept,
            event_callbacks=PublisherEventCallbacks(matched=lambda _: self._send_answer()),
        )
        self._pairs = StampPairs(self._on_observation)
        self._observations = DirectSubscriptions(self, lambda: self._pairs.lacks_first)
        if self._settings.use_lane_state:
            self._observations.subscribe(
                LaneState,
                'lane/state',
                self._pairs.add_first,
                RELIABLE_10,
                is_companion=True,
            )
        self._observations.subscribe(
            EventPacket, 'event_camera/events', self._on_packet, RELIABLE_10
        )
        self._start()

    def destroy_node(self) -> None:
        """Stop answering."""
        self._observations.stop()
        super().destroy_node()

    def _make_driver(self, name: str) -> Controller:
        """Declare the controller's parameters and make it."""
        cls = controller_class(name)
        parameters = declare_parameters(self, cls.parameters_class)
        _warm_up(cls(parameters))
        return cls(parameters)

    def _wrap_driver(self, name: str, driver: Controller) -> Controller:
        """Return what answers: the controller itself, or something that asks it."""
        del name
        return driver

    def _start(self) -> None:
        """Begin to answer."""
        self._observations.start()

    def _on_packet(self, packet: EventPacket) -> None:
        if self._settings.use_lane_state:
            self._pairs.add_second(packet)
        else:
            self._on_observation(None, packet)

    def _on_observation(self, lane: LaneState | None, packet: EventPacket) -> None:
        identity = _Identity(conversions.to_stamp_ns(packet.header.stamp), packet.seq)
        with self._lock:
            if identity != self._answered:
                self._report_lost(packet)
                self._step(lane, packet, identity.stamp_ns)
                self._answered = identity
        self._send_answer()

    def _step(self, lane: LaneState | None, packet: EventPacket, stamp_ns: int) -> None:
        lane_state = None if lane is None else conversions.lane_state_from_message(lane)
        if lane_state is not None and self._begins(lane_state.episode, lane_state.step):
            self._controller.reset(controller_rng(self._settings.seed, lane_state.episode))
        observation = Observation(stamp_ns, self._events(packet), lane_state)
        self._answer.left, self._answer.right = self._controller.step(observation)
        self._answer.header.stamp = packet.header.stamp
        if self._states.get_subscription_count():
            self._publish_state(lane)

    def _begins(self, episode: int, step: int) -> bool:
        """Return whether this observation belongs to another episode than the last one."""
        last, self._episode = self._episode, _Episode(episode, step)
        return last is None or step <= last.last_step or episode != last.number

    def _events(self, packet: EventPacket) -> object:
        try:
            return conversions.events_from_packet(packet)
        except PacketError as error:
            self.get_logger().error(
                f'event_camera/events: {error}; taken as empty', throttle_duration_sec=1.0
            )
            return no_events()

    def _report_lost(self, packet: EventPacket) -> None:
        lost = 0 if self._answered is None else packet.seq - self._answered.sequence - 1
        if lost > 0:
            self.get_logger().warning(
                f'event_camera/events: {lost} packets were lost', throttle_duration_sec=1.0
            )

    def _send_answer(self) -> None:
        with self._lock:
            is_heard = self._wheels.get_subscription_count() >= self._settings.wait_for_subscribers
            if self._answered is not None and is_heard:
                self._wheels.publish(self._answer)

    def _publish_state(self, lane: LaneState | None) -> None:
        state = self._state
        state.header.stamp = self._answer.header.stamp
        state.action = getattr(self._driver, 'action', -1)
        state.reward = getattr(self._driver, 'reward', math.nan)
        state.spikes = list(getattr(self._driver, 'spikes', ()))
        state.learning = getattr(self._driver, 'learning', False)
        if lane is not None:
            state.episode, state.step = lane.episode, lane.step
        self._states.publish(state)


def _warm_up(controller: Controller) -> None:
    """Take a step that nobody sees.

    Compiled kernels are loaded by the first call, or compiled: the robot must not wait for that.
    """
    packet = EventPacket(width=1, height=1)
    conversions.fill_event_packet(packet, no_events(), STEP_NS, 0, 'evt3')
    lane = conversions.lane_state_from_message(LaneState())
    controller.reset(controller_rng(0, 0))
    controller.step(Observation(STEP_NS, conversions.events_from_packet(packet), lane))
