"""Node `viewer`: shows in the browser what the nodes around it do, and never keeps them waiting.

Its subscriptions are best effort and keep one message: what comes while nobody looks is dropped.
So many times a second it takes what there is. They are few, as each makes every step longer:
where the robot is follows from the lane state, which the controller is sent anyway. All of the
process lets others go first.
"""

from __future__ import annotations

from collections.abc import Callable
import contextlib
from dataclasses import dataclass
import os
import sys
from typing import Any

from event_camera_msgs.msg import EventPacket
import numpy as np
from rcl_interfaces.srv import GetParameters
from rclpy.clock import Clock, ClockType
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from spikelane_msgs.msg import ControllerState, LaneState, Weights

from spikelane.viewer.scene import connect, Scene
from spikelane.viewer.server import GRPC_PORT, MEMORY_MB, ViewerServer, WEB_PORT
from spikelane_sim import topic_names
from spikelane_sim.course import load_course
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.messages import lane_state_from_message, to_stamp_ns
from spikelane_sim.nodes import conversions
from spikelane_sim.nodes.direct import SubscriptionEvents
from spikelane_sim.nodes.parameter_node import ParameterNode
from spikelane_sim.nodes.rclpy_internals import NotForExecutors, take
from spikelane_sim.nodes.ros_parameters import declare_parameters
from spikelane_sim.nodes.running import run_node
from spikelane_sim.nodes.sole_publishers import SolePublishers
from spikelane_sim.nodes.waiting import WaitingWarnings
from spikelane_sim.parameters import parameter, Parameters

#: Shows a message of a simulation time [ns].
LogMessage = Callable[[Any, int], None]

LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
#: As many arrays as a controller may have, each with a name of its own.
WEIGHTS = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)

_NICENESS = 10
_ASKING_PERIOD_S = 0.5


@dataclass(frozen=True, kw_only=True)
class ViewerParameters(Parameters):
    """What is shown, how often and where."""

    rate_hz: float = parameter(
        20.0, 'Rate at which the view is updated.', unit='Hz', low=0.1, high=200.0
    )
    course: str = parameter(
        '', 'Name or file of a course; empty: the simulator is asked for its course.'
    )
    server: str = parameter(
        '', 'Address of a Rerun server that shows the view; empty: a server is started.'
    )
    web_port: int = parameter(
        WEB_PORT,
        'Port of the web page, which only this machine can reach; 0: any free port.',
        low=0,
        high=65535,
    )
    grpc_port: int = parameter(
        GRPC_PORT,
        'Port of the data that the page shows, which only this machine can reach; 0: any free '
        'port.',
        low=0,
        high=65535,
    )
    memory_mb: int = parameter(
        MEMORY_MB,
        'Memory of the view; the oldest data are dropped beyond it.',
        unit='MB',
        low=16,
        high=10**6,
    )


class Viewer(ParameterNode):
    """Takes the latest messages so many times a second and shows them."""

    def __init__(self) -> None:
        """Start the server, where none is given, and subscribe.

        Raises:
            SpikelaneError: A parameter is not allowed, Rerun is not installed, or a port is in
                use.
        """
        super().__init__('viewer')
        self._settings = settings = declare_parameters(self, ViewerParameters)
        self._closing = contextlib.ExitStack()
        server = None if settings.server else self._start_server()
        self._scene = Scene(connect(server.address if server else settings.server))
        self._closing.callback(self._scene.close)
        self._group = NotForExecutors()
        self._events = SubscriptionEvents()
        self._events.look_regularly(self)
        self._taken = [
            self._subscribe(LaneState, topic_names.LANE_STATE, self._show_lane),
            self._subscribe(EventPacket, topic_names.EVENTS, self._show_events),
            self._subscribe(ControllerState, topic_names.CONTROLLER_STATE, self._show_controller),
            self._subscribe(Weights, topic_names.WEIGHTS, self._show_weights, WEIGHTS),
        ]
        SolePublishers(self, (topic_names.LANE_STATE, topic_names.EVENTS)).look_regularly()
        self._shown = 0
        self._waiting = WaitingWarnings(self, lambda: self._shown, self._lacks)
        # Steady time: that of the simulator may stand still.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1 / settings.rate_hz, self.take, clock=steady)
        if settings.course:
            self._scene.show_course(load_course(settings.course))
        else:
            self._client = self.create_client(GetParameters, 'simulator/get_parameters')
            self._asking = self.create_timer(_ASKING_PERIOD_S, self._ask, clock=steady)
        # Whoever reads this may count on a node that is there: it can be ended quietly, say.
        if server:
            self.get_logger().info(f'open {server.url} in a browser')

    def destroy_node(self) -> None:
        """Send what is left and end the server."""
        self._closing.close()
        super().destroy_node()

    def take(self) -> None:
        """Show what has come."""
        for subscription, show in self._taken:
            while (message := take(subscription)) is not None:
                self._shown += 1
                self._show(show, message)

    def _lacks(self) -> str:
        topics = [subscription.topic_name for subscription, _ in self._taken]
        bare = [topic for topic in topics if not self.count_publishers(topic)]
        without = f'; without a publisher: {", ".join(bare)}' if bare else ''
        return f'waiting for something to show: received {self._shown} messages{without}'

    def _start_server(self) -> ViewerServer:
        settings = self._settings
        server = ViewerServer(settings.web_port, settings.grpc_port, settings.memory_mb)
        self._closing.enter_context(server)
        return server

    def _subscribe(
        self, kind: type, topic: str, show: LogMessage, qos: QoSProfile = LATEST
    ) -> tuple[Any, LogMessage]:
        subscription = self.create_subscription(
            kind, topic, lambda message: None, qos, callback_group=self._group
        )
        self._events.add(subscription)
        return subscription, show

    def _show(self, show: LogMessage, message: Any) -> None:
        """Show a message; one that cannot be shown is reported, at a limited rate."""
        try:
            show(message, to_stamp_ns(message.header.stamp))
        except (SpikelaneError, ValueError) as error:
            self.get_logger().warning(f'not shown: {error}', throttle_duration_sec=5.0)

    def _show_lane(self, message: LaneState, stamp_ns: int) -> None:
        self._scene.show_lane(stamp_ns, lane_state_from_message(message))

    def _show_events(self, message: EventPacket, stamp_ns: int) -> None:
        events = conversions.events_from_packet(message)
        self._scene.show_events(stamp_ns, events, message.width, message.height)

    def _show_controller(self, message: ControllerState, stamp_ns: int) -> None:
        self._scene.show_controller(stamp_ns, message.neurons, message.spikes, message.reward)

    def _show_weights(self, message: Weights, stamp_ns: int) -> None:
        weights = np.array(message.data).reshape(tuple(message.shape))
        self._scene.show_weights(stamp_ns, message.name, weights)

    def _ask(self) -> None:
        # Again and again: a service drops an answer to a client that it has not met yet.
        if self._client.service_is_ready():
            request = GetParameters.Request(names=['course'])
            self._client.call_async(request).add_done_callback(self._on_course)

    def _on_course(self, answer: Future) -> None:
        if self._asking.is_canceled():  # an earlier answer has come
            return
        self._asking.cancel()
        name = answer.result().values[0].string_value
        try:
            self._scene.show_course(load_course(name))
        except SpikelaneError as error:
            self.get_logger().warning(f'the course is not shown: {error}')


def main() -> None:
    """Run the node."""
    os.nice(_NICENESS)  # of the threads to come, too
    sys.exit(run_node(Viewer))


if __name__ == '__main__':
    main()
