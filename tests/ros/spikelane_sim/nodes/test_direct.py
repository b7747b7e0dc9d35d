"""Subscriptions waited for directly: what becomes of a node whose handler fails."""

from collections.abc import Callable, Iterator
import time

from domain_coordinator import domain_id
import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64

from spikelane_sim.errors import CheckpointChoiceError, CheckpointError
from spikelane_sim.files import FileError
from spikelane_sim.nodes.direct import DirectSubscriptions

pytestmark = pytest.mark.ros

DEADLINE_S = 30.0


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> Iterator[Node]:
    """Give a node in a middleware of its own, which may be shut down."""
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    context = Context()
    with domain_id() as domain:
        rclpy.init(
            context=context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO
        )
        node = Node('failing', context=context, enable_rosout=False)
        node.exit_status = 0
        yield node
        node.destroy_node()
        rclpy.try_shutdown(context=context)


def until(condition: Callable[[], object]) -> None:
    """Wait until a condition is true."""
    deadline_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


@pytest.mark.parametrize(
    ('error', 'status', 'is_bug'),
    [
        (FileError('out: cannot be written'), 1, False),
        (CheckpointError('out: damaged'), 1, False),
        (CheckpointChoiceError('out: of another controller'), 2, False),
        (KeyError('out'), 1, True),
    ],
)
def test_an_error_in_a_handler_ends_the_node(
    node: Node, capfd: pytest.CaptureFixture[str], error: Exception, status: int, is_bug: bool
) -> None:
    """In one line with its exit status where it is no bug."""

    def fail(message: Float64) -> None:
        raise error

    direct = DirectSubscriptions(node)
    direct.subscribe(Float64, 'numbers', fail, QoSProfile(depth=1))
    direct.start()
    publisher = node.create_publisher(Float64, 'numbers', 1)
    until(publisher.get_subscription_count)
    publisher.publish(Float64())
    until(lambda: not node.context.ok())
    direct.stop()
    said = capfd.readouterr().err
    assert node.exit_status == status
    assert ('Traceback' in said) is is_bug
    assert said.count('\n') == 1 or is_bug
    assert str(error) in said
