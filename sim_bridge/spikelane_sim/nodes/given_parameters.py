"""Parameters that were given to a node and that it does not use: rclpy ignores them in silence.

They are no error, since one file may be meant for several nodes, but the node warns of each once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
import re
from typing import Any

from rclpy.node import Node

from spikelane_sim.errors import SpikelaneError
from spikelane_sim.nodes.rclpy_internals import given_parameters
from spikelane_sim.parsing import read_yaml_file

_VALUES = 'ros__parameters'


def warn_of_unused_parameters(node: Node, arguments: Sequence[str]) -> None:
    """Warn of parameters that the node does not have, and of those for other nodes alone.

    Args:
        node: Has declared all its parameters.
        arguments: Command-line arguments of its process.
    """
    unknown = [name for name in given_parameters(node) if not node.has_parameter(name)]
    if unknown:
        node.get_logger().warning(
            f'{", ".join(unknown)}: expected parameters of {node.get_name()}; ignored'
        )
    for source, names in _given(arguments):
        if names and not any(is_meant(node.get_fully_qualified_name(), name) for name in names):
            node.get_logger().warning(
                f'{source}: expected parameters of {node.get_fully_qualified_name()}, '
                f'got those of {", ".join(names)} alone; ignored'
            )


def is_meant(node: str, pattern: str) -> bool:
    """Return whether parameters under a name are for a node.

    Args:
        node: Its name with its namespace, as `/left/simulator`.
        pattern: The name, where * stands for one part and ** for any number of parts.
    """
    parts = {'*': '/[^/]+', '**': '(/[^/]+)*'}
    expression = ''.join(
        parts.get(part, '/' + re.escape(part)) for part in pattern.split('/') if part
    )
    return re.fullmatch(expression, node) is not None


def _given(arguments: Sequence[str]) -> Iterator[tuple[str, list[str]]]:
    """Yield what gives parameters: a file or an argument, and the nodes that it names."""
    is_ros = False
    for number, argument in enumerate(arguments):
        if argument in ('--ros-args', '--'):
            is_ros = argument == '--ros-args'
        following = arguments[number + 1] if number + 1 < len(arguments) else ''
        if is_ros and argument == '--params-file':
            yield following, _nodes_in(Path(following))
        elif is_ros and argument in ('-p', '--param'):
            name, separator, _ = following.partition(':=')[0].partition(':')
            yield following, [name] if separator else []


def _nodes_in(file: Path) -> list[str]:
    try:
        content = read_yaml_file(file)
    except SpikelaneError:  # the middleware has read it all the same
        return []
    return list(_nodes(content, ''))


def _nodes(content: Any, namespace: str) -> Iterator[str]:
    if not isinstance(content, Mapping):
        return
    for name, value in content.items():
        path = f'{namespace}/{str(name).strip("/")}'
        if isinstance(value, Mapping) and _VALUES in value:
            yield path
        else:
            yield from _nodes(value, path)
