"""The yardstick for lockstep over ROS: a bare rclpy ping-pong with the same messages.

`ping` publishes a lane state and an event packet, `pong` answers the packet with wheel
velocities, `ping` publishes again. Nothing is computed; both are plain nodes that rclpy spins.
"""

from __future__ import annotations

from array import array
import json
import sys
import time

from event_camera_msgs.msg import EventPacket
from rclpy.node import Node
from spikelane_msgs.msg import LaneState, WheelVelocities

from spikelane_sim import topic_names
from spikelane_sim.nodes.running import run_node


class Ping(Node):
    """Starts each round and times them; prints one JSON object at the end."""

    def __init__(self) -> None:
        """Declare what is sent; rounds begin when `pong` is there."""
        super().__init__('ping')
        self._rounds = int(self.declare_parameter('rounds', 2000).value)
        size = int(self.declare_parameter('packet_bytes', 100).value)
        self._packet = EventPacket(width=128, height=128, encoding='evt3')
        self._packet.events = array('B', bytes(size))
        self._lane = LaneState(lane='outer', section='A')
        self._packets = self.create_publisher(EventPacket, topic_names.EVENTS, 10)
        self._lanes = self.create_publisher(LaneState, topic_names.LANE_STATE, 10)
        self.create_subscription(WheelVelocities, topic_names.WHEELS, self._on_answer, 10)
        self._answers = 0
        self._start_s = 0.0
        self._waiting = self.create_timer(0.05, self._begin)

    def _begin(self) -> None:
        # Sent on every tick until the first answer comes: pong may not have met us yet.
        if self._packets.get_subscription_count():
            self._serve()

    def _serve(self) -> None:
        self._packet.header.stamp.sec = self._answers
        self._lanes.publish(self._lane)
        self._packets.publish(self._packet)

    def _on_answer(self, message: WheelVelocities) -> None:
        if message.header.stamp.sec != self._answers:
            return  # a second answer to a packet that was sent twice at the beginning
        if not self._answers:
            self._waiting.cancel()
            self._start_s = time.perf_counter()
        if self._answers == self._rounds:
            seconds = time.perf_counter() - self._start_s
            print(json.dumps({'round_trip_us': seconds / self._rounds * 1e6}), flush=True)
            self.context.try_shutdown()
            return
        self._answers += 1
        self._serve()


class Pong(Node):
    """Answers each event packet."""

    def __init__(self) -> None:
        """Subscribe as a controller does."""
        super().__init__('pong')
        self._answer = WheelVelocities(left=1.0, right=1.0)
        self._answers = self.create_publisher(WheelVelocities, topic_names.WHEELS, 10)
        self.create_subscription(LaneState, topic_names.LANE_STATE, lambda _: None, 10)
        self.create_subscription(EventPacket, topic_names.EVENTS, self._on_packet, 10)

    def _on_packet(self, message: EventPacket) -> None:
        self._answer.header.stamp = message.header.stamp
        self._answers.publish(self._answer)


def main() -> None:
    """Run the node that the first argument names."""
    sys.exit(run_node({'ping': Ping, 'pong': Pong}[sys.argv[1]], sys.argv[2:]))


if __name__ == '__main__':
    main()
