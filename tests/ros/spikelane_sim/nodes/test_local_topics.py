"""Topics between nodes of one process: order, depth, and what each node is given."""

from collections.abc import Iterator
import threading

import pytest
from std_msgs.msg import Float64

from spikelane_sim.nodes.local_topics import LocalSubscription, LocalTopics, serialised

pytestmark = pytest.mark.ros


@pytest.fixture
def local() -> Iterator[LocalTopics]:
    """Give topics that are stopped at the end."""
    local = LocalTopics()
    yield local
    local.stop()


def test_messages_wait_for_the_start_and_come_in_order_up_to_the_depth(
    local: LocalTopics,
) -> None:
    """A subscription of depth 3 handles the last 3 of 5 early messages, then the later ones."""
    seen, is_over = [], threading.Event()

    def handle(message: Float64) -> None:
        seen.append(message.data)
        if message.data == 7.0:
            is_over.set()

    subscription = LocalSubscription('/node', Float64, handle, depth=3)
    local.subscribe('/numbers', subscription)
    for number in range(5):
        local.send('/numbers', serialised(Float64(data=float(number))))
    assert seen == []
    local.start(subscription)
    local.send('/numbers', serialised(Float64(data=7.0)))
    assert is_over.wait(10.0)
    assert seen[-1] == 7.0
    assert seen[:-1] in ([2.0, 3.0, 4.0], [3.0, 4.0])  # the last one may replace the oldest


def test_a_handler_may_send_what_it_is_given_again(local: LocalTopics) -> None:
    """As two nodes in lockstep do: 5,000 messages to and fro, in one thread, without recursion."""
    threads, is_over = set(), threading.Event()

    def answer(message: Float64, topic: str) -> None:
        threads.add(threading.get_ident())
        if message.data == 5000.0:
            is_over.set()
        else:
            local.send(topic, serialised(Float64(data=message.data + 1.0)))

    there = LocalSubscription('/a', Float64, lambda each: answer(each, '/to_b'), depth=1)
    back = LocalSubscription('/b', Float64, lambda each: answer(each, '/to_a'), depth=1)
    local.subscribe('/to_a', there)
    local.subscribe('/to_b', back)
    local.start(there)
    local.start(back)
    local.send('/to_a', serialised(Float64()))
    assert is_over.wait(20.0)
    assert len(threads) == 1
    assert threads != {threading.get_ident()}


def test_the_sender_may_refill_its_message(local: LocalTopics) -> None:
    """The other node is given what the message was when it was sent."""
    seen, is_over = [], threading.Event()

    def handle(message: Float64) -> None:
        seen.append(message.data)
        is_over.set()

    subscription = LocalSubscription('/node', Float64, handle, depth=1)
    local.subscribe('/numbers', subscription)
    message = Float64(data=1.0)
    local.send('/numbers', serialised(message))
    message.data = 2.0
    local.start(subscription)
    assert is_over.wait(10.0)
    assert seen == [1.0]
