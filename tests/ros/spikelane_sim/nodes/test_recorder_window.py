"""How far a publisher may be ahead of its recorder."""

import pytest
from spikelane_msgs.msg import RecorderState

from spikelane_sim.nodes.recorder_window import RecorderWindow

pytestmark = pytest.mark.ros


def publish(window: RecorderWindow, sent: dict[str, int], steps: int) -> None:
    """Publish a message on each topic."""
    for _ in range(steps):
        for topic in sent:
            sent[topic] += 1
        window.count_step()


def test_without_a_window_nothing_waits() -> None:
    """However much is published."""
    sent = {'/a': 0}
    window = RecorderWindow(0, lambda: sent)
    publish(window, sent, 1000)
    assert not window.is_full
    assert not window.is_used


def test_it_is_full_before_the_recorder_has_said_anything() -> None:
    """After as many steps as it is wide."""
    sent = {'/a': 0}
    window = RecorderWindow(3, lambda: sent)
    publish(window, sent, 2)
    assert not window.is_full
    publish(window, sent, 1)
    assert window.is_full


def test_the_topic_that_is_furthest_behind_counts() -> None:
    """Others that the recorder does not record do not."""
    sent = {'/a': 0, '/b': 0, '/unrecorded': 0}
    window = RecorderWindow(10, lambda: sent)
    publish(window, sent, 10)
    window.update(RecorderState(topics=['/a', '/b', '/foreign'], sequence_numbers=[9, 4, 0]))
    assert not window.is_full
    assert window.steps_ahead == 6
    publish(window, sent, 4)
    assert window.is_full
    window.update(RecorderState(topics=['/a', '/b'], sequence_numbers=[14, 14]))
    assert window.steps_ahead == 0


def test_a_recorder_that_joins_late_is_not_waited_for_in_vain() -> None:
    """What was sent before it listened never reaches it."""
    sent = {'/a': 0}
    window = RecorderWindow(10, lambda: sent)
    publish(window, sent, 500)
    window.update(RecorderState(topics=['/a'], sequence_numbers=[0]))
    assert not window.is_full
    publish(window, sent, 10)
    window.update(RecorderState(topics=['/a'], sequence_numbers=[0]))
    assert window.is_full
    window.update(RecorderState(topics=['/a'], sequence_numbers=[510]))
    assert not window.is_full
