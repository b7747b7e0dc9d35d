"""A lap over ROS: starts the nodes in a domain of their own, drives in lockstep, ends them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
import contextlib
import os
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from domain_coordinator import domain_id
import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from spikelane_msgs.srv import Reset

from spikelane.executables import find_executable
from spikelane.lap import DrivenLap, LapConfig, Show
from spikelane.processes import ProcessError, Processes
from spikelane.run_folder import RunFolder
from spikelane.trajectory import Trajectory
from spikelane.trajectory_bag import read_trajectory
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.files import write_yaml

#: The first start compiles the numerical kernels, which takes long on a slow machine.
START_DEADLINE_S = 180.0
STALL_DEADLINE_S = 60.0
LAST_ANSWER_S = 5.0

#: Recorded in this order; the recorder being matched to the last of a node means to all.
TOPICS = (
    '/tf_static',
    '/robot_description',
    '/clock',
    '/tf',
    '/ground_truth/odom',
    '/lane/state',
    '/lane/distance',
    '/diagnostics',
    '/controller/state',
    '/event_camera/events',
    '/wheel_velocities',
)


def drive_lap_over_ros(config: LapConfig, folder: RunFolder, show: Show) -> DrivenLap:
    """Drive and record a lap with simulator, controller and recorder as processes.

    Args:
        config: What to drive.
        folder: Where bag, logs and node parameters go.
        show: Called about once a second.

    Raises:
        SpikelaneError: A node ended or fell silent, or the recording is not complete.
    """
    wall_time_s = _drive(config, folder, show, is_recorded=True)
    trajectory = read_trajectory(folder.bag)
    _check_complete(trajectory)
    return DrivenLap(trajectory, wall_time_s, folder.bag)


def drive_unrecorded(config: LapConfig, folder: RunFolder) -> float:
    """Drive without a recorder.

    Returns:
        The wall time from the first observation to the last [s].

    Raises:
        SpikelaneError: A node ended or fell silent.
    """
    return _drive(config, folder, lambda step, progress_m: None, is_recorded=False)


@contextlib.contextmanager
def own_domain() -> Iterator[dict[str, str]]:
    """Reserve a ROS domain that nobody else on this machine uses.

    Yields:
        The environment variables that keep processes in it.
    """
    before = dict(os.environ)
    with domain_id() as domain:
        own = {'ROS_DOMAIN_ID': str(domain), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
        # The supervisor reads them in this process, else it would meet other machines' nodes.
        os.environ |= own
        try:
            yield own
        finally:
            os.environ.clear()
            os.environ |= before


def _drive(config: LapConfig, folder: RunFolder, show: Show, *, is_recorded: bool) -> float:
    nodes = ('recorder',) * is_recorded + ('simulator', config.controller)
    parameters = folder.path / 'parameters.yaml'
    write_yaml(parameters, node_parameters(config, folder, is_recorded=is_recorded))
    with own_domain() as environment, Processes() as processes:
        for node in nodes:
            command = [str(find_executable(node)), '--ros-args', '--params-file', str(parameters)]
            log = folder.path / 'logs' / f'{node}.log'
            processes.start(node, command, log, os.environ | environment)
        with _Supervisor(int(environment['ROS_DOMAIN_ID']), processes) as supervisor:
            wall_time_s = supervisor.drive(config, show)
        # The recorder goes last: what the others sent is on its way to it.
        processes.stop('simulator', config.controller)
        processes.stop(*nodes)
        _check_endings(processes)
    return wall_time_s


def node_parameters(config: LapConfig, folder: RunFolder, *, is_recorded: bool) -> dict[str, Any]:
    """Return the parameter file of a lap's nodes.

    Simulator and controller wait for each other and the recorder before they publish.
    """
    both = {'seed': config.seed, 'wait_for_subscribers': 1 + is_recorded}
    simulator = config.simulator.to_dict() | both | {'autostart': False}
    controller = config.controller_parameters.to_dict() | both
    recorder = {
        'output': str(folder.bag.absolute()),
        'topics': list(TOPICS),
        'custom_data': [f'seed={config.seed}', f'controller={config.controller}'],
    }
    groups = {'simulator': simulator, config.controller: controller, 'recorder': recorder}
    return {name: {'ros__parameters': values} for name, values in groups.items()}


class _Supervisor:
    """A node that resets the simulator and watches it by its diagnostics.

    It does not listen to lane/state: one more reader of every step would slow the lockstep.
    """

    def __init__(self, domain: int, processes: Processes) -> None:
        self._processes = processes
        self._context = Context()
        # Signals are the command's business; it ends the children.
        rclpy.init(
            context=self._context,
            domain_id=domain,
            signal_handler_options=SignalHandlerOptions.NO,
        )
        self._node = Node(
            'lap', context=self._context, start_parameter_services=False, enable_rosout=False
        )
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._values: Mapping[str, str] = {}
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        self._reset = self._node.create_client(Reset, '/simulator/reset')

    def __enter__(self) -> _Supervisor:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def drive(self, config: LapConfig, show: Show) -> float:
        """Drive one episode; return its wall time [s]."""
        self._wait_for('the simulator', self._reset.service_is_ready)
        # The simulator's diagnostics must reach us before the one that says it is over.
        self._wait_for('diagnostics of the simulator', lambda: bool(self._values))
        request = Reset.Request(lane=config.lane, seed=config.seed)
        answer = self._reset.call_async(request)
        self._wait_for(f'{config.controller} and the recorder to join', answer.done)
        if not answer.result().success:
            raise SpikelaneError(f'reset: {answer.result().message}')
        start_s = time.monotonic()
        self._watch(show)
        return time.monotonic() - start_s

    def _watch(self, show: Show) -> None:
        step, changed_s = -1, time.monotonic()
        while not self._is_over(time.monotonic() - changed_s):
            self._spin()
            if (now := int(self._values.get('step', -1))) != step:
                step, changed_s = now, time.monotonic()
                show(step, float(self._values.get('progress_m', 0.0)))
            if time.monotonic() - changed_s > STALL_DEADLINE_S:
                raise ProcessError(f'no step was taken for {STALL_DEADLINE_S:g} s')

    def _is_over(self, quiet_s: float) -> bool:
        """Return whether the episode is over and its last observation answered, as it should."""
        is_answered = self._values.get('answered') == 'True' or quiet_s > LAST_ANSWER_S
        return is_answered and self._values.get('terminated') == 'True'

    def _wait_for(self, what: str, is_there: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + START_DEADLINE_S
        while not is_there():
            if time.monotonic() > deadline_s:
                raise ProcessError(f'waited {START_DEADLINE_S:g} s for {what}')
            self._spin()

    def _spin(self) -> None:
        self._executor.spin_once(timeout_sec=0.1)
        self._processes.check()

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == 'simulator':
                self._values = {pair.key: pair.value for pair in status.values}


def _check_complete(trajectory: Trajectory) -> None:
    observations = int(trajectory.step[-1]) + 1
    # Nobody waits for the answer to the last one.
    unanswered = int(np.isnan(trajectory.left_rad_s[:-1]).sum())
    if len(trajectory) < observations or unanswered:
        raise ProcessError(
            f'the recording has {len(trajectory)} of {observations} observations and lacks '
            f'{unanswered} answers: the machine is too busy'
        )


def _check_endings(processes: Processes) -> None:
    wrong = [f'{name} ({status})' for name, status in processes.statuses().items() if status]
    if wrong:
        raise ProcessError(f'ended with an error: {", ".join(wrong)}; see the logs')
