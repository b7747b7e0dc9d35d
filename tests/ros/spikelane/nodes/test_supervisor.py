"""What watches a graph: it names a simulator that ends, whatever was on its way before."""

from pathlib import Path
import signal
import sys

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from spikelane.nodes.domain import own_domain
from spikelane.nodes.graph import Supervisor
from spikelane.processes import ProcessError, Processes

pytestmark = pytest.mark.ros

#: Ends as a node does that a signal tells to end, after a moment.
ENDING = (
    'import signal, sys, time\n'
    'print("ended by SIGTERM in episode 1", flush=True)\n'
    'signal.signal(signal.SIGTERM, lambda *_: (time.sleep(1.5), sys.exit(143)))\n'
    'signal.pause()\n'
)


def test_a_simulator_that_ends_is_named_though_it_said_before_that_it_plays(
    tmp_path: Path,
) -> None:
    """The message from before the signal arrives last; only then the one that it is quitting."""
    log = tmp_path / 'simulator.log'
    with own_domain() as domain, Processes() as processes:
        processes.start('simulator', [sys.executable, '-c', ENDING], log, domain.environment)
        context = Context()
        rclpy.init(
            context=context,
            domain_id=domain.number,
            signal_handler_options=SignalHandlerOptions.NO,
        )
        with Supervisor(domain.number, processes) as supervisor:
            node = Node('simulator', context=context, enable_rosout=False)
            publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)

            def say(state: str) -> None:
                status = DiagnosticStatus(name='simulator', message=state)
                status.values = [KeyValue(key='steps', value='3')]
                publisher.publish(DiagnosticArray(status=[status]))

            supervisor.wait_for('the publisher', publisher.get_subscription_count)
            supervisor.wait_for('the process', lambda: log.exists() and 'ended' in log.read_text())
            say('playing')
            say('quitting')
            processes._children['simulator'].send_signal(signal.SIGTERM)
            with pytest.raises(ProcessError) as ended:
                supervisor.check_simulator()
            node.destroy_node()
        rclpy.shutdown(context=context)
    assert str(ended.value).startswith('simulator ended with status 143 (SIGTERM): ended by SIG')
