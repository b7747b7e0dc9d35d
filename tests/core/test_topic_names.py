"""The names of topics stand in one place."""

import ast
from pathlib import Path

import pytest

from spikelane_sim import topic_names

ROOT = Path(__file__).parents[2]
NAMES = {value for name, value in vars(topic_names).items() if name.isupper()}
MODULES = [
    path
    for folder in ('sim_bridge', 'controllers', 'ros2_ws/src/spikelane')
    for path in sorted((ROOT / folder).rglob('*.py'))
    if path.name != 'topic_names.py'
]


def test_the_names_are_those_that_users_have_in_their_files() -> None:
    """Relative names, and four that no namespace changes."""
    assert {
        'event_camera/events',
        'event_camera/camera_info',
        'event_camera/image_raw',
        'lane/state',
        'lane/distance',
        'ground_truth/odom',
        'odometry',
        'joint_states',
        'robot_description',
        'wheel_velocities',
        'wheel_velocity_controller/commands',
        'cmd_vel',
        'joy',
        'dead_man_switch',
        'controller/state',
        'controller/weights',
        'controller/recorded',
        '/clock',
        '/tf',
        '/tf_static',
        '/diagnostics',
        'recorder/state',
        'recorder/published',
        'simulator/parameter_changes',
        'controller/parameter_changes',
    } == NAMES


@pytest.mark.parametrize('path', MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_other_module_writes_the_name_of_a_topic(path: Path) -> None:
    """No text consists of such a name alone; help and docstrings may mention topics."""
    written = {
        node.value
        for node in ast.walk(ast.parse(path.read_text('utf-8')))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }
    assert not written & (NAMES | {f'/{name}' for name in NAMES})
