"""The layout for Foxglove and the configuration for RViz against what the nodes publish."""

from collections.abc import Iterator
import importlib
import json
from pathlib import Path
import re
from typing import Any

import pytest
import yaml

from spikelane.runs.lap.nodes.driving import recorded_topics

pytestmark = pytest.mark.ros

CONFIG = Path(__file__).parents[3] / 'ros2_ws/src/spikelane/config'
#: What each display of RViz's default plugins subscribes to.
RVIZ_TYPES = {
    'rviz_default_plugins/Image': 'sensor_msgs/msg/Image',
    'rviz_default_plugins/Odometry': 'nav_msgs/msg/Odometry',
    'rviz_default_plugins/RobotModel': 'std_msgs/msg/String',
}
#: What each panel of Foxglove can show.
FOXGLOVE_TYPES = {
    '/robot_description': 'std_msgs/msg/String',
    '/ground_truth/odom': 'nav_msgs/msg/Odometry',
    '/event_camera/image_raw': 'sensor_msgs/msg/Image',
    '/event_camera/camera_info': 'sensor_msgs/msg/CameraInfo',
    '/diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
}
#: Published to who asks, but no part of a lap's recording.
NOT_RECORDED = {
    '/event_camera/image_raw',
    '/event_camera/camera_info',
}


@pytest.fixture(scope='module')
def published(graph: Any) -> dict[str, list[str]]:
    """Return topics and types that a simulator and a controller that learns publish."""
    graph.start('simulator', {'robot.model': 'kinematic', 'autostart': 'false'})
    graph.start('rstdp')
    node = graph.node
    # The last that each of them begins to publish.
    graph.until(lambda: all(map(node.count_publishers, ('/wheel_velocities', '/diagnostics'))))
    return {
        name: types
        for name, types in node.get_topic_names_and_types()
        if node.get_publishers_info_by_topic(name)
    }


@pytest.fixture(scope='module')
def layout() -> dict[str, Any]:
    """Return the layout for Foxglove."""
    return json.loads((CONFIG / 'foxglove.json').read_text())


@pytest.fixture(scope='module')
def rviz() -> dict[str, Any]:
    """Return the configuration for RViz."""
    return yaml.safe_load((CONFIG / 'spikelane.rviz').read_text())


def paths_in(layout: dict[str, Any]) -> Iterator[str]:
    """Yield the topics and paths to fields that a layout's panels name."""
    for config in layout['configById'].values():
        yield from config.get('topics', {})
        yield from config.get('imageMode', {}).values()
        yield from (path['value'] for path in config.get('paths', ()))
        yield from (config[key] for key in ('topicPath', 'topicToRender') if key in config)


def panels_in(tree: Any) -> Iterator[str]:
    """Yield the panels in a layout's tree."""
    if isinstance(tree, str):
        yield tree
        return
    assert tree['direction'] in ('row', 'column')
    assert 0 < tree['splitPercentage'] < 100
    yield from panels_in(tree['first'])
    yield from panels_in(tree['second'])


def test_every_panel_is_placed_once(layout: dict[str, Any]) -> None:
    """And each is of a kind that Foxglove has; the file has the parts that it wants."""
    assert sorted(panels_in(layout['layout'])) == sorted(layout['configById'])
    kinds = {name.partition('!')[0] for name in layout['configById']}
    assert kinds == {'3D', 'Image', 'Plot', 'RawMessages', 'DiagnosticSummary'}
    assert {'globalVariables', 'userNodes', 'playbackConfig'} <= layout.keys()


def test_foxglove_is_given_fields_that_are_published(
    layout: dict[str, Any], published: dict[str, list[str]]
) -> None:
    """Every topic has a publisher of the type shown, every path leads to a field of it."""
    paths = list(paths_in(layout))
    assert len(paths) >= 12
    for path in paths:
        topic, *fields = path.split('.')
        assert topic in published
        [type_name] = published[topic]
        assert FOXGLOVE_TYPES.get(topic, type_name) == type_name
        package, _, name = type_name.partition('/msg/')
        kind = getattr(importlib.import_module(f'{package}.msg'), name)
        for field in fields:
            name, is_item = re.fullmatch(r'(\w+)(\[\d+\])?', field).groups()
            type_of_field = kind.get_fields_and_field_types()[name]
            assert type_of_field.startswith('sequence<') == bool(is_item)


def test_what_is_shown_of_a_bag_is_in_it(layout: dict[str, Any]) -> None:
    """All but the pictures, which a lap does not record."""
    topics = {path.partition('.')[0] for path in paths_in(layout)}
    # Names in the layout are those without a namespace.
    recorded = {f'/{name.removeprefix("/")}' for name in recorded_topics('rstdp')}
    assert topics - recorded == NOT_RECORDED


def test_rviz_is_given_topics_that_are_published(
    rviz: dict[str, Any], published: dict[str, list[str]]
) -> None:
    """Each of the type its display takes, and with a quality of service that is offered."""
    displays = rviz['Visualization Manager']['Displays']
    shown = {}
    for display in displays:
        topic = display.get('Topic') or display.get('Description Topic')
        if topic:
            shown[topic['Value']] = topic
            assert published[topic['Value']] == [RVIZ_TYPES[display['Class']]]
    assert set(shown) == {'/robot_description', '/ground_truth/odom', '/event_camera/image_raw'}
    # The description is sent once, before RViz is there.
    assert shown['/robot_description']['Durability Policy'] == 'Transient Local'
    assert '/tf' in published
    assert '/tf_static' in published


def test_rviz_looks_at_frames_that_there_are(rviz: dict[str, Any]) -> None:
    """The world's frame, as the transforms name it."""
    manager = rviz['Visualization Manager']
    assert manager['Global Options']['Fixed Frame'] == 'odom'
    assert manager['Views']['Current']['Target Frame'] == 'odom'
