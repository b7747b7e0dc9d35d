"""What a node has published arrives, though it has been told to end."""

from pathlib import Path
import signal
import time
from typing import Any

import pytest
from rosbags.highlevel import AnyReader

pytestmark = pytest.mark.ros

STEPS = 400
#: Longer than a node takes to end that does not wait, and than what its sockets hold.
ASLEEP_S = 1.5
#: Longer than the recorder takes to know of the simulator; it cannot be asked whether it does.
KNOWN_S = 3.0
TOPICS = ('/lane/state', '/event_camera/events')


def test_a_recorder_that_slept_gets_it_all(graph: Any, tmp_path: Path) -> None:
    """The simulator waits for it, and then ends quietly."""
    bag = tmp_path / 'bag'
    recorder = graph.start('recorder', {'output': bag, 'topics': f'[{", ".join(TOPICS)}]'})
    simulator = graph.start(
        'simulator',
        {
            'robot.model': 'kinematic',
            'episode.max_steps': STEPS,
            'wait_for_subscribers': 2,
            'history_depth': 2 * STEPS,
        },
    )
    graph.until(lambda: 'recording 2 topics' in recorder.log, 'the recorder')
    graph.until(lambda: graph.node.count_publishers('lane/state'), 'the simulator')
    time.sleep(KNOWN_S)
    recorder.send(signal.SIGSTOP)
    graph.start('braitenberg')
    graph.until(lambda: f'ended after {STEPS} steps' in simulator.log, 'the drive')
    simulator.send(signal.SIGINT)
    time.sleep(ASLEEP_S)
    assert simulator.status is None
    recorder.send(signal.SIGCONT)
    assert simulator.wait() == 0
    assert recorder.stop() == 0
    with AnyReader([bag]) as reader:
        counts = {each.topic: each.msgcount for each in reader.connections}
    assert counts == dict.fromkeys(TOPICS, STEPS + 1)
    assert 'Traceback' not in simulator.log
