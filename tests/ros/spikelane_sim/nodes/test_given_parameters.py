"""Parameters that a node does not use are told of once, whatever file they are in."""

from pathlib import Path
from typing import Any

import pytest
from rcl_interfaces.srv import GetParameters

from spikelane_sim.nodes.given_parameters import is_meant

pytestmark = pytest.mark.ros

FILES = {
    'other.yaml': 'braitenberg:\n  ros__parameters: {seed: 5}\n',
    'typo.yaml': '/simulater:\n  ros__parameters: {seed: 5}\n',
    'nested.yaml': 'left:\n  simulator:\n    ros__parameters: {seed: 5}\n',
    'wild.yaml': '/**:\n  ros__parameters: {history_depth: 7}\n',
    'both.yaml': (
        'braitenberg:\n  ros__parameters: {seed: 5}\nsimulator:\n  ros__parameters: {seed: 9}\n'
    ),
}


@pytest.mark.parametrize(
    ('pattern', 'is_meant_for_it'),
    [
        ('/**', True),
        ('/left/simulator', True),
        ('left/simulator', True),
        ('/*/simulator', True),
        ('/**/simulator', True),
        ('/left/**', True),
        ('/left/*', True),
        ('simulator', False),
        ('/*', False),
        ('/left', False),
        ('/left/simulator/more', False),
        ('/left/simulator2', False),
    ],
)
def test_names_in_a_file_stand_for_nodes_as_in_ros(pattern: str, is_meant_for_it: bool) -> None:
    """A name without a namespace is in the root."""
    assert is_meant('/left/simulator', pattern) == is_meant_for_it


def test_files_for_other_nodes_alone_are_named_once(graph: Any, tmp_path: Path) -> None:
    """Files that name this node too, or all nodes, are fine."""
    arguments: list[str] = []
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
        arguments += ['--params-file', str(tmp_path / name)]
    arguments += ['-p', 'simulater:lane:=inner', '-p', 'simulator:robot.model:=kinematic']
    process = graph.start('simulator', {}, *arguments)
    graph.until(lambda: 'seed 9' in process.log)
    expected = {
        f'{tmp_path}/other.yaml: expected parameters of /simulator, '
        'got those of /braitenberg alone; ignored',
        f'{tmp_path}/typo.yaml: expected parameters of /simulator, '
        'got those of /simulater alone; ignored',
        f'{tmp_path}/nested.yaml: expected parameters of /simulator, '
        'got those of /left/simulator alone; ignored',
        'simulater:lane:=inner: expected parameters of /simulator, '
        'got those of simulater alone; ignored',
    }
    graph.until(lambda: all(process.log.count(line) == 1 for line in expected), 'the warnings')
    assert process.log.count('; ignored') == len(expected)
    assert process.stop() == 0


def test_a_recorder_tells_of_them_too(graph: Any, tmp_path: Path) -> None:
    """Its file for the simulator, and a parameter that it does not have."""
    file = tmp_path / 'other.yaml'
    file.write_text(FILES['other.yaml'])
    parameters = {'outptu': 'x', 'output': str(tmp_path / 'bag')}
    process = graph.start('recorder', parameters, '--params-file', str(file))
    graph.until(lambda: 'got those of /braitenberg alone; ignored' in process.log)
    graph.until(lambda: 'outptu: expected parameters of recorder; ignored' in process.log)
    assert process.stop() == 0


def test_former_names_are_taken_as_todays(graph: Any) -> None:
    """The node tells of both, and warns of neither."""
    former = {'robot.model': 'kinematic', 'robot.wheel_friction': 0.5}
    process = graph.start('simulator', former)
    graph.until(lambda: 'seed 0' in process.log)
    names = ['robot.model', 'robot.engine', 'robot.pybullet.wheel_friction', *former]
    values = graph.call(GetParameters, 'simulator/get_parameters', names=names).values
    texts = [value.string_value for value in values[:2]]
    assert texts == ['p3dx', 'kinematic']
    assert [values[2].double_value, values[4].double_value] == [0.5, 0.5]
    assert 'ignored' not in process.log
    assert process.stop() == 0
