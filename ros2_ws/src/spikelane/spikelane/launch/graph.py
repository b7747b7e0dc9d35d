"""The nodes that launch files start, and the order in which all ends.

Parameters are those of the YAML files, shipped or given, with what the arguments say on top.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
import signal
import sys
from tempfile import NamedTemporaryFile
from types import MappingProxyType
from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext
from launch.actions import EmitEvent, RegisterEventHandler, Shutdown
from launch.event_handlers import OnProcessExit
from launch.events import matches_action
from launch.events.process import ShutdownProcess
from launch_ros.actions import Node
from launch_ros.utilities import prefix_namespace

from spikelane.executables import (
    composed_command,
    executables,
    is_installed_by_pip,
    MODULE_ARGUMENTS,
)
from spikelane.launch.arguments import Arguments
from spikelane.runs.lap.nodes.driving import recorded_topics
from spikelane_controllers.registry import controller_class, controller_packages
from spikelane_controllers.weights import shipped_weights
from spikelane_sim import topic_names
from spikelane_sim.errors import ParameterError
from spikelane_sim.files import write_yaml
from spikelane_sim.nodes.meeting import meeting_parameters
from spikelane_sim.parameters import flatten
from spikelane_sim.parsing import ParseError, read_yaml_file
from spikelane_sim.period import TimedParameters

#: Topics whose names are fixed: within a namespace of its own, a simulator's are its own too.
_GLOBAL_TOPICS = (topic_names.CLOCK, topic_names.TF, topic_names.TF_STATIC)

#: Topics on which publishers meet the recorder, in the recorder's namespace.
_MEETING_TOPICS = (topic_names.RECORDER_STATE, topic_names.PUBLISHED)

#: How a node may end that was told to: at its leisure, or by the signals of a launch.
_TOLD_STATUSES = (
    0,
    *(status for each in (signal.SIGINT, signal.SIGTERM) for status in (-each, 128 + each)),
)


def driving(
    name: str,
    arguments: Arguments,
    simulator_own: Mapping[str, Any],
    controller_own: Mapping[str, Any] = MappingProxyType({}),
    *,
    namespace: str = '',
) -> list[Node]:
    """Return simulator and controller, in one process where the argument `composed` is true.

    The simulator has the argument's scenario, and the controller the weights shipped for it, where
    it has some. Both have the argument's seed.

    Args:
        name: The controller's in the registry.
        arguments: Arguments of the launch.
        simulator_own: More parameters of the simulator, under dotted names.
        controller_own: The same of the controller.
        namespace: Namespace of the nodes within that of the launch.
    """
    parameters = {
        'simulator': _simulator_parameters(arguments, name) | {**simulator_own},
        name: _controller_parameters(arguments, name) | {**controller_own},
    }
    if arguments.is_true('composed'):
        return [_composed(arguments, name, namespace, parameters)]
    return [_node(arguments, node, namespace, [own]) for node, own in parameters.items()]


def _simulator_parameters(arguments: Arguments, driver: str) -> dict[str, Any]:
    """Return the simulator's parameters; it waits for the driver, in the same namespace."""
    shipped = _shipped('spikelane_sim', f'scenario_{arguments.text("scenario")}')
    file = Path(arguments.text('simulator_file') or shipped)
    seed = {'seed': arguments.number('seed')}
    waiting, _ = meeting_parameters(driver, is_recorded=arguments.is_true('record'))
    speed = arguments.positive('speed')
    given = {**_period(arguments), **({} if speed is None else {'speed': speed})}
    return {**_in_file(file, 'simulator'), **given, **seed, **waiting, **_for_others(arguments)}


def _controller_parameters(arguments: Arguments, name: str) -> dict[str, Any]:
    shipped = _shipped(controller_packages()[name], name)
    given = arguments.text('controller_file')
    course = f'scenario_{arguments.text("scenario")}'
    weights = {'checkpoint': course} if course in shipped_weights(name) and not given else {}
    seed = {'seed': arguments.number('seed')}
    _, waiting = meeting_parameters(name, is_recorded=arguments.is_true('record'))
    # Another package need not have a file of defaults.
    file = _in_file(Path(given or shipped), name) if given or Path(shipped).exists() else {}
    period = _controller_period(arguments, name)
    return {**file, **weights, **period, **seed, **waiting, **_for_others(arguments)}


def _period(arguments: Arguments) -> dict[str, int]:
    """Return the control period as a parameter, where one was given."""
    period_ms = arguments.period_ms
    return {} if period_ms is None else {'period_ms': period_ms}


def _controller_period(arguments: Arguments, name: str) -> dict[str, int]:
    """Return the control period as a controller's parameter, where it has one."""
    is_timed = issubclass(controller_class(name).parameters_class, TimedParameters)
    return _period(arguments) if is_timed else {}


def controller_on_robot(
    name: str, robot: str, arguments: Arguments, others: Mapping[str, Any]
) -> Node:
    """Return a controller that drives a real robot, and waits for nobody.

    Args:
        name: In the registry.
        robot: Name of the file of the robot's parameters, in the folder config.
        arguments: Arguments of the launch.
        others: More parameters, under dotted names.
    """
    shipped = Path(_shipped(controller_packages()[name], name))
    file = _in_file(shipped, name) if shipped.exists() else {}
    base = _in_file(Path(arguments.text('robot_file') or _shipped('spikelane', robot)), name)
    own = {'seed': arguments.number('seed'), **_controller_period(arguments, name)}
    return _node(arguments, name, '', [file, base, own, others])


def _for_others(arguments: Arguments) -> dict[str, int]:
    """Return the parameters with which nodes wait for subscribers from outside the launch."""
    names = ('wait_for_subscribers', 'history_depth')
    given = {name: arguments.number(name) for name in names if arguments.text(name)}
    return {name: number for name, number in given.items() if number}


def recorder(
    arguments: Arguments,
    facts: Mapping[str, Any],
    topics: Sequence[str] | None = None,
) -> Node:
    """Return the recorder of some topics.

    Args:
        arguments: Arguments of the launch.
        facts: About the run, kept in the bag's metadata.
        topics: What to record; None for all of a lap with the controller that `facts` name.
    """
    names = list(topics or recorded_topics(str(facts['controller'])))
    settings = {
        'output': arguments.text('bag'),
        'topics': names,
        'needed': [name for name in names if name.endswith(topic_names.LANE_STATE)],
        'custom_data': [f'{name}={value}' for name, value in facts.items()],
    }
    file = _in_file(Path(_shipped('spikelane', 'recorder')), 'recorder')
    return _node(arguments, 'recorder', '', [file, settings])


def viewer(arguments: Arguments, others: Mapping[str, Any], *, namespace: str = '') -> Node:
    """Return the viewer, with parameters."""
    return _node(arguments, 'viewer', namespace, [others])


def whole_run(
    arguments: Arguments,
    groups: Sequence[Sequence[Node]],
    facts: Sequence[str],
    topics: Sequence[str] | None = None,
    shown: str = '',
) -> list[Any]:
    """Return the nodes of a run, a recorder and a viewer if asked for, and how all end.

    Args:
        arguments: Arguments of the launch.
        groups: The nodes that drive, as in `end_in_order`.
        facts: Names of the arguments that are kept in the bag's metadata.
        topics: As in `recorder`.
        shown: Namespace that the viewer shows.
    """
    kept = {name: arguments.text(name) for name in facts}
    recording = [recorder(arguments, kept, topics)] if arguments.is_true('record') else []
    viewing = [viewer(arguments, {}, namespace=shown)] if arguments.is_true('viewer') else []
    ending = end_in_order(groups, recording, viewing)
    return [*ending, *recording, *viewing, *(node for group in groups for node in group)]


def end_in_order(
    groups: Sequence[Sequence[Node]], last: Sequence[Node], viewing: Sequence[Node]
) -> list[RegisterEventHandler]:
    """Let nodes end when they have nothing more to do, and those that record after the others.

    The launch fails, with an error that says so, where a node fails, and where one that records or
    shows ends before the others: they may be waiting for it. All others are ended then.

    Args:
        groups: When one of a group ends, the others of the group are ended.
        last: Those that record; ended when all groups have.
        viewing: Those that show; where there are any the launch goes on then, until Ctrl-C.
    """
    running = [list(group) for group in groups]
    recording = list(last)
    told: list[Node] = []

    def end(nodes: Sequence[Node]) -> list[EmitEvent]:
        told.extend(nodes)
        return [
            EmitEvent(event=ShutdownProcess(process_matcher=matches_action(node)))
            for node in nodes
        ]

    def on_exit(event: Any, context: LaunchContext) -> list[Any]:
        node = event.action
        is_told = context.is_shutdown or node in told
        if event.returncode not in (_TOLD_STATUSES if is_told else (0,)):
            raise RuntimeError(f'{_ended(event)}; its output says why')
        for group in [*running, recording]:
            if node in group:
                group.remove(node)
                if group and group is not recording:
                    return list(end(group))
        if any(running):
            if node in (*last, *viewing) and not context.is_shutdown:
                raise RuntimeError(f'{_ended(event)}, expected it to run until the drive is over')
            return []
        if recording:
            return list(end(recording))
        return [] if viewing else [Shutdown(reason='all is done')]

    nodes = [node for group in groups for node in group]
    return [
        RegisterEventHandler(OnProcessExit(target_action=node, on_exit=on_exit))
        for node in [*nodes, *last, *viewing]
    ]


def _ended(event: Any) -> str:
    node = event.action
    name = node.node_name if node.is_node_name_fully_specified() else event.process_name
    return f'{name} ended with status {event.returncode}'


def in_namespace(namespace: str) -> list[str]:
    """Return the topics to record in a namespace, which is named after its controller."""
    topics = recorded_topics(namespace)
    return [
        f'{namespace}/{topic.lstrip("/")}' for topic in topics if topic != topic_names.DIAGNOSTICS
    ]


def _composed(
    arguments: Arguments, name: str, namespace: str, parameters: Mapping[str, Mapping[str, Any]]
) -> Node:
    """Return the process of two nodes; it is called what they are together in the log."""
    given, remappings = _place(arguments, namespace)
    # As launch_ros does with the parameters of a node, which has one name here.
    with NamedTemporaryFile(prefix='launch_params_', suffix='.yaml', delete=False) as file:
        path = Path(file.name)
    write_yaml(path, {f'/**/{node}': {'ros__parameters': own} for node, own in parameters.items()})
    program, *rest = composed_command(name)
    return Node(
        executable=program,
        arguments=rest,
        exec_name=f'simulator+{name}',
        namespace=given,
        parameters=[str(path)],
        remappings=remappings,
        output='screen',
    )


def _node(
    arguments: Arguments, name: str, namespace: str, parameters: Sequence[Mapping[str, Any]]
) -> Node:
    given, remappings = _place(arguments, namespace)
    by_pip = is_installed_by_pip(name)
    return Node(
        package=None if by_pip else executables()[name],
        executable=sys.executable if by_pip else name,
        arguments=[*MODULE_ARGUMENTS, name] if by_pip else None,
        name=name,
        namespace=given,
        parameters=[{key: value for each in parameters for key, value in each.items()}],
        remappings=remappings,
        output='screen',
    )


def _place(arguments: Arguments, namespace: str) -> tuple[str, list[tuple[str, str]]]:
    """Return the namespace of a node, and the topics that have other names there."""
    given = prefix_namespace(arguments.text('namespace') or None, namespace or None) or ''
    remappings = []
    if arguments.pushed_namespace or given.strip('/'):
        remappings += [(topic, topic[1:]) for topic in _GLOBAL_TOPICS]
    if namespace:  # the recorder is not in it
        outer = prefix_namespace(arguments.pushed_namespace, arguments.text('namespace') or None)
        outer = f'/{(outer or "").strip("/")}'.rstrip('/')
        remappings += [(topic, f'{outer}/{topic}') for topic in _MEETING_TOPICS]
    return given, remappings


def _shipped(package: str, name: str) -> str:
    return str(Path(get_package_share_directory(package), 'config', f'{name}.yaml'))


def _in_file(file: Path, node: str) -> dict[str, Any]:
    """Return a node's parameters in a file, under dotted names.

    They are read here, as a name in a file does not stand for a node in a namespace.
    """
    try:
        content = read_yaml_file(file)
    except ParseError as error:
        raise ParameterError(f'{file}: {error}') from None
    found: dict[str, Any] = {}
    for key in ('/**', node, f'/{node}'):
        found |= flatten(content.get(key, {}).get('ros__parameters', {}))
    return found
