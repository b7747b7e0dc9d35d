"""A lap whose recorder loses messages of topics that no figure is made of fails and names them."""

from __future__ import annotations

from pathlib import Path
import re
import sys

import pytest

from spikelane.nodes import graph
from spikelane.processes import ProcessError
from spikelane.runs.configuration import Request
from spikelane.runs.folder import RunFolder
from spikelane.runs.lap.config import LapConfig
from spikelane.runs.lap.nodes.driving import drive_lap_over_ros

pytestmark = pytest.mark.ros

STEPS = 120  # three messages of each topic are lost
TOPICS = ('/clock', '/tf', '/lane/distance', '/controller/state')


@pytest.mark.parametrize('where', ['arrival', 'bag'])
def test_each_topic_is_counted_at_the_end(
    tmp_path: Path, where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether the recorder has noticed the loss or not: by its numbers, or in the bag."""
    usual = graph.node_command
    losing = [sys.executable, str(Path(__file__).with_name('losing_recorder.py')), where]
    monkeypatch.setattr(
        graph,
        'node_command',
        lambda node: [*losing, ','.join(TOPICS)] if node == 'recorder' else usual(node),
    )
    parameters = {'simulator.robot.model': 'kinematic', 'simulator.episode.max_steps': STEPS}
    config = LapConfig.make(Request('1', 'braitenberg', 3, 'ros', parameters), 'outer')
    folder = RunFolder.create(tmp_path / 'lap', numbered=False)
    with pytest.raises(ProcessError) as failed:
        drive_lap_over_ros(config, folder, lambda step, progress_m: None)
    said = str(failed.value)
    if where == 'arrival':
        assert said.startswith('recorder ended with status 1: ')
        lost = dict(re.findall(r'(/[a-z/]+) (\d+)', said.partition('messages lost: ')[2]))
        assert {topic: lost.get(topic) for topic in TOPICS} == dict.fromkeys(TOPICS, '3')
    else:
        assert said == (
            'the recording lacks 3 of 121 messages of /clock, 3 of 121 messages of /tf, 3 of 121 '
            'messages of /lane/distance, 2 of 120 messages of /controller/state'
        )
