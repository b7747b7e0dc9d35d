"""Node `load_publisher`: publishes a known number of messages, to measure what a recorder loses.

Prints one line of JSON: how many were sent on each topic, and how many seconds that took.
"""

from __future__ import annotations

import array
from collections.abc import Sequence
import json
import os
import sys
import time
from typing import Any

import rclpy
from rclpy.duration import Duration
from std_msgs.msg import UInt8MultiArray

from spikelane_sim.nodes.network import network_variables

_MATCH_TIMEOUT_S = 20.0


def main(args: list[str] | None = None) -> int:
    """Publish `count` messages at `rate` on as many topics as there are `sizes`.

    Returns:
        0; 1 if nobody subscribed.
    """
    os.environ |= network_variables(os.environ)
    rclpy.init(args=args)
    node = rclpy.create_node('load_publisher')
    rate = node.declare_parameter('rate', 1000.0).value
    count = node.declare_parameter('count', 5000).value
    sizes = node.declare_parameter('sizes', [250, 500, 1000, 3000]).value
    publishers = [
        node.create_publisher(UInt8MultiArray, f'load_{number}', 10)
        for number in range(len(sizes))
    ]
    messages = [UInt8MultiArray(data=array.array('B', _noise(size))) for size in sizes]
    deadline = time.monotonic() + _MATCH_TIMEOUT_S
    while not all(publisher.get_subscription_count() for publisher in publishers):
        if time.monotonic() > deadline:
            return 1
        time.sleep(0.01)
    seconds = _publish(publishers, messages, rate, count)
    for publisher in publishers:
        publisher.wait_for_all_acked(Duration(seconds=5))
    sent = {publisher.topic_name: 0 for publisher in publishers}
    for number in range(count):
        sent[publishers[number % len(publishers)].topic_name] += 1
    print(json.dumps({'sent': sent, 'seconds': seconds}), flush=True)
    rclpy.try_shutdown()
    return 0


def _publish(publishers: Sequence[Any], messages: Sequence[Any], rate: float, count: int) -> float:
    """Publish round robin at the rate and return how long it took [s]."""
    start = time.perf_counter()
    for number in range(count):
        pause = start + number / rate - time.perf_counter()
        if pause > 0:
            time.sleep(pause)
        message = messages[number % len(messages)]
        message.data[:8] = array.array('B', number.to_bytes(8, 'little'))
        publishers[number % len(publishers)].publish(message)
    return time.perf_counter() - start


def _noise(size: int) -> bytes:
    """Return bytes that compress about as well as event packets do."""
    return bytes((position * position * 31 >> 3) & 0x3F for position in range(size))


if __name__ == '__main__':
    sys.exit(main())
