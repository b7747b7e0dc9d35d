#!/usr/bin/env python3
"""Write docs/reference from the nodes as they are: python docs/make_reference.py [--check].

Every node is started, in several ways where its topics depend on parameters, and asked what it
publishes, serves and declares. Only what things mean comes from docs/reference/meanings.yaml; a
name that is missing there is an error, as is one that no node has.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
import contextlib
from dataclasses import dataclass, field
import importlib
import os
from pathlib import Path
import re
import sys
import tempfile
from typing import Any, NamedTuple
from unittest.mock import patch

import rclpy
from rclpy.action import get_action_server_names_and_types_by_node
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
import yaml

from spikelane_controllers.dqn_snn.transfer import TransferParameters
from spikelane_controllers.learning.gathering import GatheringParameters
from spikelane_controllers.registry import controller_packages, training_names
from spikelane_sim.files import write_text_atomically
from spikelane_sim.nodes.ros_parameters import declare_parameters
from spikelane_sim.sensor_preset import load_preset, preset_names

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / 'docs/reference'
MEANINGS = FOLDER / 'meanings.yaml'

#: A namespace tells names that are relative from those that are not.
_SPACE = '/reference'
_DESCRIPTION = re.compile(
    r'(?P<text>.*?)(?: \[(?P<unit>[^\]]*)\])?(?: Source: (?P<source>.*?)\.)?'
    r'(?: Can be changed while the node runs: from the (?P<changes>.*) on\.)?'
)
_NONE = '–'  # noqa: RUF001  # a dash stands where there is nothing
_INTEGER_MAX = 2**63 - 1
_KINDS = {
    Parameter.Type.BOOL: 'bool',
    Parameter.Type.INTEGER: 'int',
    Parameter.Type.DOUBLE: 'double',
    Parameter.Type.STRING: 'string',
    Parameter.Type.DOUBLE_ARRAY: 'double[]',
    Parameter.Type.STRING_ARRAY: 'string[]',
}


class Start(NamedTuple):
    """A way to start a node."""

    note: str  # when its topics are as they are then; '' for the usual
    parameters: Mapping[str, Any]


class Executable(NamedTuple):
    """A node, and how it is started to be asked."""

    package: str
    make: Callable[[], Node]
    starts: Sequence[Start]


class Topic(NamedTuple):
    """What a node publishes, subscribes to, serves or calls; names as the node gives them."""

    name: str
    kind: str  # its type
    role: str  # publishes, subscribes, serves, calls, action
    qos: str


class Row(NamedTuple):
    """A parameter."""

    name: str
    kind: str
    default: str
    allowed: str
    unit: str
    meaning: str
    place: str


@dataclass
class Found:
    """What a node has, however it is started."""

    topics: dict[Topic, list[str]] = field(default_factory=dict)  # with the notes of the starts
    rows: list[Row] = field(default_factory=list)


# ------------------------------------------------------------------------- what is asked


def executables(folder: Path) -> dict[str, Executable]:
    """Return all nodes; what they write goes into a folder."""
    nodes = {
        'simulator': Executable(
            'spikelane_sim',
            _class('spikelane_sim.nodes.simulator', 'SimulatorNode'),
            (
                Start('', {}),
                Start('`mode` realtime', {'mode': 'realtime'}),
                Start(
                    '`mode` realtime, `use_stamped_vel`',
                    {'mode': 'realtime', 'use_stamped_vel': True},
                ),
                Start('`recorder_window_steps` above 0', {'recorder_window_steps': 400}),
            ),
        )
    }
    for name, package in controller_packages().items():
        if package != 'spikelane_controllers':
            continue
        learns = name in training_names()
        own = 'learning.LearningNode' if learns else 'controller.ControllerNode'
        module, cls = f'spikelane_controllers.nodes.{own}'.rsplit('.', 1)
        starts = [Start('', {}), Start('`use_lane_state` false', {'use_lane_state': False})]
        starts.append(Start('`recorder_window_steps` above 0', {'recorder_window_steps': 600}))
        starts += _starts_with_a_base()
        if learns:
            output = {'learning': True, 'output': str(folder / name)}
            starts.append(Start('`learning`', output))
            starts += _starts_on_a_robot(folder / f'{name}_on_a_robot')
        nodes[name] = Executable('spikelane_controllers', _class(module, cls, name), starts)
    bag = str(ROOT / 'tests/data/bag_none')
    for module, cls, parameters in (
        ('spikelane.nodes.recorder', 'Recorder', {'output': str(folder / 'bag')}),
        ('spikelane.runs.replay.nodes.replay', 'ReplayNode', {'bag': bag}),
        ('spikelane.nodes.viewer', 'Viewer', {'web_port': 0, 'grpc_port': 0}),
        (
            'spikelane.nodes.camera_calibration',
            'CameraCalibration',
            {'file': str(folder / 'camera.yaml')},
        ),
    ):
        make = _class(module, cls)
        nodes[module.rpartition('.')[2]] = Executable('spikelane', make, (Start('', parameters),))
    nodes['lane_from_pose'] = Executable(
        'spikelane',
        _class('spikelane.nodes.lane_from_pose', 'LaneFromPose'),
        (Start('', {}), Start('`source` transforms', {'source': 'transforms'})),
    )
    nodes['wheels_to_twist'] = Executable(
        'spikelane',
        _class('spikelane.nodes.wheels_to_twist', 'WheelsToTwist'),
        (
            Start('', {}),
            Start('`use_stamped_vel`', {'use_stamped_vel': True}),
            Start('`dead_man` joystick', {'dead_man': 'joystick'}),
            Start('`dead_man` bool', {'dead_man': 'bool'}),
        ),
    )
    return nodes


def _starts_with_a_base() -> list[Start]:
    """Return the starts of a controller that drives a robot's base."""
    return [
        Start('`command` twist', {'command': 'twist'}),
        Start('`command` twist_stamped', {'command': 'twist_stamped'}),
        *(
            Start(f'`base.dead_man` {kind}', {'command': 'twist', 'base.dead_man': kind})
            for kind in ('joystick', 'bool')
        ),
    ]


def _starts_on_a_robot(output: Path) -> list[Start]:
    """Return the starts of a controller that learns without a simulator."""
    usual = {'learning': True, 'use_lane_state': False, 'command': 'twist'}
    return [
        Start(
            f'`learning`, `lane_source` {source}',
            {**usual, 'lane_source': source, 'output': f'{output}_{source}'},
        )
        for source in ('distance', 'state')
    ]


def _class(module: str, name: str, *arguments: str) -> Callable[[], Node]:
    return lambda: getattr(importlib.import_module(module), name)(*arguments)


def ask_all() -> dict[str, Found]:
    """Start every node and return what it has."""
    # What every node has is told once.
    with _running(lambda: Node('bare'), {}) as (bare, _):
        usual_topics, usual_rows = set(_topics(bare)), set(_parameters(bare))
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, executable in executables(Path(folder)).items():
            found[name] = Found()
            for start in executable.starts:
                with _running(executable.make, start.parameters) as (node, defaults):
                    for topic in _topics(node):
                        if topic not in usual_topics:
                            found[name].topics.setdefault(topic, []).append(start.note)
                    if not start.note:
                        names = [each for each in _parameters(node) if each not in usual_rows]
                        found[name].rows = list(_rows(node, names, defaults))
    return found


def _parameters(node: Node) -> list[str]:
    return list(node.list_parameters([], 0).names)


def ask_parameters(cls: type) -> list[Row]:
    """Return the rows of parameters that no node has, as a node would declare them."""
    with _running(lambda: Node('bare'), {}) as (node, defaults):
        before = set(_parameters(node))
        declare_parameters(node, cls)
        names = [name for name in _parameters(node) if name not in before]
        return list(_rows(node, names, defaults))


@contextlib.contextmanager
def _running(
    make: Callable[[], Node], parameters: Mapping[str, Any]
) -> Iterator[tuple[Node, dict[str, Any]]]:
    """Run a node; yield it and the defaults that it declares, whatever it was given."""
    arguments = ['--ros-args', '-r', f'__ns:={_SPACE}', '--log-level', 'error']
    for name, value in parameters.items():
        arguments += ['-p', f'{name}:={value}']
    defaults: dict[str, Any] = {}
    declare = Node.declare_parameter

    def note(node: Node, name: str, value: Any = None, *others: Any) -> Parameter:
        defaults[name] = value
        return declare(node, name, value, *others)

    rclpy.init(args=arguments)
    try:
        with patch.object(Node, 'declare_parameter', note):
            node = make()
            try:
                yield node, defaults
            finally:
                node.destroy_node()
    finally:
        rclpy.try_shutdown()


def _topics(node: Node) -> Iterator[Topic]:
    """Yield what the graph knows of a node, the insides of actions left out."""
    own = (node.get_name(), node.get_namespace())
    profiles: dict[tuple[str, str], list[str]] = {}
    for role, endpoints in (('publishes', node.publishers), ('subscribes', node.subscriptions)):
        for endpoint in endpoints:
            found = profiles.setdefault((role, endpoint.topic_name), [])
            found.append(_qos(endpoint.qos_profile))
    actions = get_action_server_names_and_types_by_node(node, *own)
    for role, named in (
        ('publishes', node.get_publisher_names_and_types_by_node(*own)),
        ('subscribes', node.get_subscriber_names_and_types_by_node(*own)),
        ('serves', node.get_service_names_and_types_by_node(*own)),
        ('calls', node.get_client_names_and_types_by_node(*own)),
        ('action', actions),
    ):
        for name, kinds in named:
            if '/_action/' not in name:
                (kind,) = kinds
                qos = '; '.join(profiles.get((role, name), []))
                yield Topic(_relative(name, node.get_name()), kind, role, qos)


def _relative(name: str, node: str) -> str:
    """Return a name as the node gives it: ~/ its own, / fixed, all others in its namespace."""
    inner = name.removeprefix(f'{_SPACE}/')
    return f'~/{inner.removeprefix(f"{node}/")}' if inner.startswith(f'{node}/') else inner


def _qos(profile: QoSProfile) -> str:
    reliable = profile.reliability == ReliabilityPolicy.RELIABLE
    latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    words = ['reliable' if reliable else 'best effort'] + ['latched'] * latched
    return f'{", ".join(words)}, depth {profile.depth}'


def _rows(node: Node, names: Sequence[str], defaults: Mapping[str, Any]) -> Iterator[Row]:
    for descriptor in node.describe_parameters(names):
        parts = _DESCRIPTION.fullmatch(descriptor.description)
        assert parts  # the pattern takes any text
        default, changes = defaults[descriptor.name], parts['changes']
        yield Row(
            descriptor.name,
            _KINDS[Parameter.Type.from_parameter_value(default)] if default != [] else 'string[]',
            _value(default),
            _allowed(descriptor),
            parts['unit'] or '',
            parts['text'] + (f' *Changes from the {changes} on.*' if changes else ''),
            parts['source'] or '',
        )


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return "''" if value == '' else str(value)


def _allowed(descriptor: Any) -> str:
    """Return the range that a descriptor gives, '' where it gives none."""
    for bounds in (*descriptor.integer_range, *descriptor.floating_point_range):
        has_low = bounds.from_value not in (float('-inf'), -_INTEGER_MAX)
        has_high = bounds.to_value not in (float('inf'), _INTEGER_MAX)
        if has_low and has_high:
            return f'{bounds.from_value:,.10g} to {bounds.to_value:,.10g}'
        sign, bound = ('≥', bounds.from_value) if has_low else ('≤', bounds.to_value)
        return f'{sign} {bound:,.10g}'
    words = str(descriptor.additional_constraints)
    return words.removeprefix('one of ') if words.startswith('one of ') else ''


# ------------------------------------------------------------------------- what is written


def check_meanings(found: Mapping[str, Found], meanings: Mapping[str, Any]) -> None:
    """Check that everything has a meaning, and every meaning is of something.

    Raises:
        SystemExit: It is not so; the message names what is missing or too much.
    """
    names = {'nodes': set(found), 'names': {t.name for f in found.values() for t in f.topics}}
    for group, there in names.items():
        for name in there ^ set(meanings[group]):
            problem = 'needs a meaning' if name in there else 'has a meaning, but no node has it'
            raise SystemExit(f'{MEANINGS.relative_to(ROOT)}: {group}: {name} {problem}')


def pages(found: Mapping[str, Found], meanings: Mapping[str, Any]) -> dict[str, str]:
    """Return the pages by file name."""
    texts = {f'{name}.md': _node_page(name, each, meanings) for name, each in found.items()}
    texts['transfer.md'] = _transfer_page()
    texts['presets.md'] = _presets_page()
    texts['README.md'] = _index(found, meanings)
    return texts


def _index(found: Mapping[str, Found], meanings: Mapping[str, Any]) -> str:
    nodes = [[f'[`{name}`]({name}.md)', meanings['nodes'][name]] for name in found]
    by_topic: dict[tuple[str, str], dict[str, list[str]]] = {}
    for node, each in found.items():
        for topic in each.topics:
            if topic.role in ('publishes', 'subscribes'):
                roles = by_topic.setdefault((topic.name, topic.kind), {})
                roles.setdefault(topic.role, [])
                if node not in roles[topic.role]:
                    roles[topic.role].append(node)
    topics = [
        [f'`{name}`', _linked(kind), *(', '.join(roles.get(role, [])) for role in _ROLES[:2])]
        for (name, kind), roles in sorted(by_topic.items())
    ]
    return (
        f'{_HEAD}# Topics and parameters\n\n{meanings["introduction"]}\n## Nodes\n\n'
        f'{_table(("node", "what it does"), nodes)}\n'
        'Parameters of `spikelane transfer`, which is no node: [transfer](transfer.md). Presets '
        'of event cameras: [presets](presets.md).\n\n'
        f'## Topics\n\n{_table(("topic", "type", "published by", "subscribed to by"), topics)}'
    )


def _node_page(name: str, found: Found, meanings: Mapping[str, Any]) -> str:
    parts = [f'{_HEAD}# `{name}`\n\n{meanings["nodes"][name]}\n']
    for role, title in zip(_ROLES, _TITLES, strict=True):
        rows = [
            [
                f'`{topic.name}`',
                _linked(topic.kind),
                *([topic.qos] if role in _ROLES[:2] else []),
                meanings['names'][topic.name] + _when(notes),
            ]
            for topic, notes in sorted(found.topics.items())
            if topic.role == role
        ]
        if rows:
            qos = ('quality of service',) if role in _ROLES[:2] else ()
            parts.append(f'\n## {title}\n\n{_table(("name", "type", *qos, "meaning"), rows)}')
    return ''.join([*parts, '\n## Parameters\n\n', _parameter_table(found.rows)])


def _transfer_page() -> str:
    parts = [f'{_HEAD}# Parameters of `spikelane transfer`\n\nGiven as `--param NAME=VALUE`.\n']
    for prefix, cls in (('transfer', TransferParameters), ('gathering', GatheringParameters)):
        rows = [row._replace(name=f'{prefix}.{row.name}') for row in ask_parameters(cls)]
        parts.append(f'\n## {prefix.capitalize()}\n\n{_parameter_table(rows)}')
    return ''.join(parts)


def _presets_page() -> str:
    """Return what the sensor presets set, each value with its source."""
    presets = {name: load_preset(name) for name in preset_names()}
    parts = [
        f'{_HEAD}# Sensor presets\n\n`--preset NAME` gives the simulator these parameters; '
        '[sensors](../sensors.md) tells how they are used. Basis: *read*, the source was looked '
        'up for the preset; *measured*, in the recording that is named; *quoted*, from the source '
        'that is named, which was not looked up again; *assumed* by us.\n'
    ]
    for name, preset in presets.items():
        rows = [
            [f'`{key}`', f'`{each["value"]}`', each['basis'], each['source']]
            for key, each in preset['values'].items()
        ]
        remarks = ''.join(f'- {remark}\n' for remark in preset['remarks'])
        parts.append(
            f'\n## {preset["title"]}: `{name}`\n\n'
            f'The camera has {preset["width"]} x {preset["height"]} pixels.\n\n'
            f'{_table(("parameter", "value", "basis", "source"), rows)}'
            + (f'\n{remarks}' if remarks else '')
        )
    return ''.join(parts)


def _parameter_table(rows: Iterable[Row]) -> str:
    head = ('name', 'type', 'default', 'allowed', 'unit', 'meaning', 'source')
    return _table(
        head, [[f'`{row.name}`', row.kind, f'`{row.default}`', *row[3:]] for row in rows]
    )


def _when(notes: Sequence[str]) -> str:
    """Say when a node has something, where it has not always."""
    least = [note for note in notes if not any(note.startswith(f'{other},') for other in notes)]
    return '' if '' in notes else f' Only with {" or ".join(least)}.'


def _linked(kind: str) -> str:
    """Return a type, with a link where its definition is in this repository."""
    package, folder, name = kind.split('/')
    file = Path('msgs', package, folder, f'{name}.{folder}')
    is_here = (ROOT / file).exists()
    return f'[{package}/{name}](../../{file})' if is_here else f'{package}/{name}'


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ['---'] * len(head)]
    lines += [[cell.replace('|', r'\|') or _NONE for cell in row] for row in rows]
    return ''.join(f'| {" | ".join(line)} |\n' for line in lines)


_ROLES = ('publishes', 'subscribes', 'serves', 'calls', 'action')
_TITLES = ('Publishes', 'Subscribes to', 'Services', 'Calls', 'Actions')
_HEAD = '<!-- Made by docs/make_reference.py. -->\n\n'


def main() -> int:
    """Write the pages, or compare them with those that are there.

    Returns:
        0; 1 where pages were to be the same and are not.
    """
    parser = argparse.ArgumentParser(description='Write docs/reference from the nodes.')
    parser.add_argument('--check', action='store_true', help='only say which pages differ')
    options = parser.parse_args()
    meanings = yaml.safe_load(MEANINGS.read_text('utf-8'))
    found = ask_all()
    check_meanings(found, meanings)
    texts = pages(found, meanings)
    there = {path.name: path.read_text('utf-8') for path in FOLDER.glob('*.md')}
    different = [name for name in {**texts, **there} if texts.get(name) != there.get(name)]
    for name in different:
        if options.check:
            print(f'docs/reference/{name}: expected what docs/make_reference.py writes')
        elif name in texts:
            write_text_atomically(FOLDER / name, texts[name])
        else:
            (FOLDER / name).unlink()
    return 1 if options.check and different else 0


if __name__ == '__main__':
    # Nobody else's nodes are to be met.
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'OFF'
    sys.exit(main())
