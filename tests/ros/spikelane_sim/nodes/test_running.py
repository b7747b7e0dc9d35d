"""How a node's process ends when a signal comes while the node is being made."""

import subprocess
import sys
import time

MAKE_AFTER_SIGNAL = """
import os, signal, sys, time
import rclpy
from rclpy.node import Node
from spikelane_sim.errors import ParameterError
from spikelane_sim.nodes.direct import DirectSubscriptions
from spikelane_sim.nodes.running import run_node

def make():
    node = Node('early')
    observations = DirectSubscriptions(node)
    os.kill(os.getpid(), signal.SIGTERM)
    while rclpy.ok():
        time.sleep(0.01)
    {rest}

sys.exit(run_node(make, []))
"""


def _end(rest: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, '-c', MAKE_AFTER_SIGNAL.format(rest=rest)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def test_an_error_that_a_signal_caused_is_not_taken_for_a_wrong_start() -> None:
    """No parameter can be declared once the middleware is shut down: the signal tells."""
    ended = _end("raise ParameterError('output: expected a text')")
    assert (ended.returncode, ended.stderr) == (143, '')


def test_subscriptions_that_start_after_a_signal_end_without_a_traceback() -> None:
    """The thread that would wait for messages has no middleware to wait with."""
    ended = _end('observations.start(); observations.stop(); return node')
    assert (ended.returncode, ended.stderr) == (0, '')


def test_a_node_that_is_still_being_made_ends_soon() -> None:
    """Compiling kernels takes a minute on a busy machine, and asks nobody."""
    start_s = time.monotonic()
    ended = _end('time.sleep(60)')
    assert (ended.returncode, ended.stderr) == (143, '')
    assert time.monotonic() - start_s < 40.0
