"""A graph of nodes of our own: started as processes in a domain of their own, and watched."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
import contextlib
import os
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from spikelane_msgs.srv import Reset

from spikelane.executables import composed_command, node_command
from spikelane.interruption import check
from spikelane.nodes.domain import own_domain
from spikelane.processes import ProcessError, Processes
from spikelane.runs.folder import RunFolder
from spikelane_sim import topic_names
from spikelane_sim.files import write_yaml

#: The first start compiles the numerical kernels, which takes long on a slow machine.
START_DEADLINE_S = 180.0
STALL_DEADLINE_S = 60.0
#: A recorder that is merely slow, on a busy disk say, is waited for much longer.
RECORDER_DEADLINE_S = 600.0
_END_DEADLINE_S = 20.0

#: The transport, and the name of the process that has both nodes.
COMPOSED = 'composed'


@contextlib.contextmanager
def running_nodes(
    parameters: Mapping[str, Mapping[str, Any]],
    folder: RunFolder,
    viewer: Mapping[str, Any] | None = None,
    composed: str = '',
) -> Iterator[tuple[Processes, Supervisor]]:
    """Run nodes in a domain of their own; leaving the block ends them.

    Args:
        parameters: By node, in the order in which they are started; kept in the folder.
        folder: Folder of the run; logs go there too.
        viewer: Parameters of a viewer that is to watch; None: there is none.
        composed: The controller that is in one process with the simulator; '': none.

    Raises:
        SpikelaneError: A node is not installed or cannot be started.
    """
    if viewer is not None:  # nobody waits for it
        watched = {'course': parameters['simulator']['course'], **viewer}
        parameters = {**parameters, 'viewer': watched}
    file = folder.path / 'parameters.yaml'
    write_yaml(file, {name: {'ros__parameters': values} for name, values in parameters.items()})
    with own_domain() as domain, Processes(kept_open=(domain.reservation,)) as processes:
        for process, command in _commands(parameters, composed).items():
            command = [*command, '--ros-args', '--params-file', str(file)]
            log = folder.path / 'logs' / f'{process}.log'
            processes.start(process, command, log, os.environ | domain.environment)
        with Supervisor(domain.number, processes) as supervisor:
            yield processes, supervisor


def driving_processes(controller: str, transport: str) -> tuple[str, ...]:
    """Return the names of the processes that drive, the one with the controller last.

    Args:
        controller: Name of the controller.
        transport: 'ros' or 'composed'.
    """
    return (COMPOSED,) if transport == COMPOSED else ('simulator', controller)


def _commands(nodes: Iterable[str], composed: str) -> dict[str, list[str]]:
    """Return the command of each process, in the order of the nodes."""
    commands = {}
    for node in nodes:
        if composed and node in ('simulator', composed):
            commands[COMPOSED] = composed_command(composed)
        else:
            commands[node] = node_command(node)
    return commands


class Supervisor:
    """A node that watches the simulator by its diagnostics, and the processes.

    It does not listen to lane/state: one more reader of every step would slow the lockstep.

    Attributes:
        reset: Client of the simulator's seeded reset. It may be asked once there are values.
        values: Values of the simulator's last diagnostics.
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
            'supervisor',
            context=self._context,
            start_parameter_services=False,
            enable_rosout=False,
        )
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self.values: Mapping[str, str] = {}
        self._is_quitting = False
        self._heard = 0  # messages of the simulator
        # The client comes first. A service drops an answer to a client that it has not met within
        # 0.1 s; whoever hears the simulator's diagnostics has been met, and so was, in the order
        # of their making, all that was made before.
        self.reset = self._node.create_client(Reset, '/simulator/reset')
        self._node.create_subscription(
            DiagnosticArray, topic_names.DIAGNOSTICS, self._on_diagnostics, 10
        )

    def __enter__(self) -> Supervisor:
        """Return the supervisor; leaving the block ends it."""
        return self

    def __exit__(self, *_: object) -> None:
        """End it."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def wait_for(self, what: str, is_there: Callable[[], bool]) -> None:
        """Wait until something is there.

        Raises:
            ProcessError: It takes too long, or a process ends.
        """
        deadline_s = time.monotonic() + START_DEADLINE_S
        while not is_there():
            if time.monotonic() > deadline_s:
                raise ProcessError(f'waited {START_DEADLINE_S:g} s for {what}')
            self.spin()

    def watch(
        self,
        is_over: Callable[[float], bool],
        show: Callable[[], None],
        *,
        may_end: Sequence[str] = (),
        start_s: float = STALL_DEADLINE_S,
    ) -> None:
        """Watch the simulator take steps.

        Args:
            is_over: Given how long there was no step [s], says whether to stop.
            show: Called when steps were taken.
            may_end: Processes that may end by themselves.
            start_s: How long the first step may take [s].

        Raises:
            ProcessError: No step is taken for too long, or a process ends.
        """
        steps, changed_s, allowed_s = '', time.monotonic(), start_s
        while not is_over(time.monotonic() - changed_s):
            self.spin(may_end)
            if (now := self.values.get('steps', '')) != steps:
                allowed_s = STALL_DEADLINE_S if now not in ('', '0') else start_s
                steps, changed_s = now, time.monotonic()
                show()
            waits = self.values.get('waits_for_recorder') == 'True'
            if time.monotonic() - changed_s > (RECORDER_DEADLINE_S if waits else allowed_s):
                raise ProcessError(_stalled(RECORDER_DEADLINE_S if waits else allowed_s, waits))

    def check_simulator(self, may_end: Sequence[str] = ()) -> None:
        """Check that the simulator is not about to end, which makes other nodes fail as well.

        It says once a second what it does. What it said before it was about to end may still be
        on its way, so that only its second message from now on is believed.

        Args:
            may_end: As in `spin`.

        Raises:
            ProcessError: It has ended, or another process has.
        """
        heard = self._heard
        deadline_s = time.monotonic() + _END_DEADLINE_S
        while time.monotonic() < deadline_s and (self._heard < heard + 2 or self._is_quitting):
            self.spin(may_end)

    def spin(self, may_end: Sequence[str] = ()) -> None:
        """Handle what has come, and check that all processes run but those that may end."""
        self._executor.spin_once(timeout_sec=0.1)
        check()
        self._processes.check(may_end)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == 'simulator':
                self._heard += 1
                self._is_quitting = status.message == 'quitting'
                self.values = {pair.key: pair.value for pair in status.values}


def _stalled(seconds: float, waits_for_recorder: bool) -> str:
    reason = ': the recorder writes nothing' if waits_for_recorder else ''
    return f'no step was taken for {seconds:g} s{reason}'
