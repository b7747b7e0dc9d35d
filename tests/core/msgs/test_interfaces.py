"""The interfaces, whose type hashes must be those of the official packages."""

from __future__ import annotations

import json
import os
from pathlib import Path
import re
from xml.etree import ElementTree

import pytest
from rosbags.typesys import get_types_from_msg, get_typestore, Stores
from rosbags.typesys.store import Typestore

from spikelane_sim import contract

MSGS = Path(__file__).resolve().parents[3] / 'msgs'

#: RIHS01 hashes read out of builds of the official packages, versions for Jazzy.
OFFICIAL = json.loads((Path(__file__).parents[2] / 'data/type_hashes.json').read_text())


@pytest.fixture(scope='module')
def types() -> Typestore:
    """Return Jazzy's types and the messages defined here."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for file in sorted(MSGS.glob('*/msg/*.msg')):
        name = f'{file.parts[-3]}/msg/{file.stem}'
        store.types.pop(name, None)
        store.register(get_types_from_msg(file.read_text(), name))
    return store


@pytest.mark.parametrize(
    'name',
    [
        f'{path.parts[-3]}/msg/{path.stem}'
        for path in sorted(MSGS.glob('*/msg/*.msg'))
        if path.parts[-3] != 'spikelane_msgs'
    ],
)
def test_messages_have_the_official_hash(types: Typestore, name: str) -> None:
    """Calculated by rosbags from the definition."""
    assert types.hash_rihs01(name) == OFFICIAL[name]


@pytest.mark.ros
@pytest.mark.parametrize(
    'name',
    [
        '/'.join([path.parts[-3], path.parts[-2], path.stem])
        for path in sorted(MSGS.glob('*/*/*.*'))
        if path.parts[-3] != 'spikelane_msgs'
    ],
)
def test_built_interfaces_have_the_official_hash(name: str) -> None:
    """Calculated by rosidl; an action's parts too."""
    hashes = _built_hashes(name)
    assert hashes[name] == OFFICIAL[name]
    for part in set(hashes) & set(OFFICIAL):
        assert hashes[part] == OFFICIAL[part]


def _built_hashes(name: str) -> dict[str, str]:
    for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(':'):
        package, kind, definition = name.split('/')
        file = Path(prefix, 'share', package, kind, f'{definition}.json')
        if prefix and file.exists():
            entries = json.loads(file.read_text())['type_hashes']
            return {entry['type_name']: entry['hash_string'] for entry in entries}
    pytest.skip(f'{name} is not built')


@pytest.mark.parametrize(
    ('name', 'constants'),
    [
        (
            'simulation_interfaces/msg/Result',
            {
                'RESULT_FEATURE_UNSUPPORTED': 0,
                'RESULT_OK': 1,
                'RESULT_NOT_FOUND': 2,
                'RESULT_INCORRECT_STATE': 3,
                'RESULT_OPERATION_FAILED': 4,
            },
        ),
        (
            'simulation_interfaces/msg/SimulationState',
            {
                'STATE_STOPPED': 0,
                'STATE_PLAYING': 1,
                'STATE_PAUSED': 2,
                'STATE_QUITTING': 3,
                'STATE_NO_WORLD': 4,
                'STATE_LOADING_WORLD': 5,
            },
        ),
        (
            'simulation_interfaces/msg/SimulatorFeatures',
            {
                'ENTITY_STATE_GETTING': 10,
                'ENTITY_STATE_SETTING': 11,
                'SIMULATION_RESET': 20,
                'SIMULATION_RESET_TIME': 21,
                'SIMULATION_RESET_STATE': 22,
                'SIMULATION_STATE_GETTING': 24,
                'SIMULATION_STATE_SETTING': 25,
                'SIMULATION_STATE_PAUSE': 26,
                'STEP_SIMULATION_SINGLE': 31,
                'STEP_SIMULATION_MULTIPLE': 32,
                'STEP_SIMULATION_ACTION': 33,
            },
        ),
        (
            'spikelane_msgs/msg/LaneState',
            {
                'NOT_TERMINATED': '',
                'TERMINATED_LANE_LOST': contract.TERMINATED_LANE_LOST,
                'TERMINATED_LAPS_COMPLETE': contract.TERMINATED_LAPS_COMPLETE,
                'TERMINATED_STEP_LIMIT': contract.TERMINATED_STEP_LIMIT,
            },
        ),
    ],
)
def test_constants_have_the_values_agreed_on(
    types: Typestore, name: str, constants: dict[str, int | str]
) -> None:
    """Hashes do not cover them."""
    assert {each: getattr(types.types[name], each) for each in constants} == constants


def test_every_field_of_ours_is_commented() -> None:
    """A comment stands above each field, or above the group it belongs to."""
    for file in sorted(MSGS.glob('spikelane_msgs/*/*')):
        for group in re.split(r'\n\n|\n---\n', file.read_text()):
            assert group.startswith('#'), f'{file.name}: {group}'


def test_the_workspace_has_the_packages_and_their_kinds() -> None:
    """Those that `colcon build` in ros2_ws builds, and how."""
    source = MSGS.parent / 'ros2_ws/src'
    files = [*source.glob('*/package.xml'), *source.glob('*/*/package.xml')]
    manifests = [ElementTree.parse(file) for file in files]
    assert {each.findtext('name'): each.findtext('export/build_type') for each in manifests} == {
        'event_camera_msgs': 'ament_cmake',
        'simulation_interfaces': 'ament_cmake',
        'spikelane': 'ament_python',
        'spikelane_controllers': 'ament_python',
        'spikelane_msgs': 'ament_cmake',
        'spikelane_sim': 'ament_python',
        'tf2_msgs': 'ament_cmake',
    }
