"""The pages in docs/reference, against the nodes as they are."""

from __future__ import annotations

import importlib.util
from pathlib import Path
import subprocess
import sys
from typing import Any

import pytest

pytestmark = pytest.mark.ros

ROOT = Path(__file__).parents[3]
FOLDER = ROOT / 'docs/reference'
SCRIPT = ROOT / 'docs/make_reference.py'


@pytest.fixture(scope='module')
def script() -> Any:
    """Give the module that writes the pages."""
    spec = importlib.util.spec_from_file_location('make_reference', SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules['make_reference'] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_the_pages_are_what_the_nodes_say() -> None:
    """Otherwise: python docs/make_reference.py."""
    done = subprocess.run(
        [sys.executable, str(SCRIPT), '--check'], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (0, ''), done.stdout + done.stderr


def test_what_a_user_relies_on_is_in_the_pages() -> None:
    """Read as text, so that the script cannot have written nothing."""
    simulator = (FOLDER / 'simulator.md').read_text('utf-8')
    packet = '[event_camera_msgs/EventPacket](../../msgs/event_camera_msgs/msg/EventPacket.msg)'
    assert f'| `event_camera/events` | {packet} | reliable, depth 10 | ' in simulator
    assert '| `robot_description` | std_msgs/String | reliable, latched, depth 1 | ' in simulator
    assert '| `cmd_vel` | geometry_msgs/Twist | ' in simulator
    assert '| `~/simulate_steps` | ' in simulator
    assert '| `camera.fov_deg` | double | `100.0` | 1 to 170 | deg | ' in simulator
    rstdp = (FOLDER / 'rstdp.md').read_text('utf-8')
    assert '| `c_r` | double | `0.01` | 0 to 1,000,000 | 1/(ms m) | ' in rstdp
    assert '| `simulator/reset` | ' in rstdp


@pytest.mark.parametrize(
    ('named', 'message'),
    [
        (['wheel_velocities'], 'names: lane/state needs a meaning'),
        (
            ['lane/state', 'wheel_velocities', 'x'],
            'names: x has a meaning, but no node has it',
        ),
    ],
)
def test_every_topic_has_a_meaning_and_every_meaning_a_topic(
    script: Any, named: list[str], message: str
) -> None:
    """One that is missing, or too much, is named."""
    topics = {
        script.Topic('lane/state', 'p/msg/T', 'subscribes', ''): [''],
        script.Topic('wheel_velocities', 'p/msg/T', 'publishes', ''): [''],
    }
    meanings = {'nodes': {'n': 'N.'}, 'names': dict.fromkeys(named, 'M.')}
    with pytest.raises(SystemExit, match=message):
        script.check_meanings({'n': script.Found(topics)}, meanings)
