"""What the tests of nodes share: a ROS domain of their own, and real node processes in it."""

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
import functools
import os
from pathlib import Path
import signal
import subprocess
import time
from typing import Any

from domain_coordinator import domain_id
import pytest
from rcl_interfaces.srv import ListParameters
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from spikelane.executables import find_executable
from spikelane.processes import end_with

DEADLINE_S = 60.0
TURN_S = 0.05
ASK_AGAIN_S = 1.0


class NodeProcess:
    """A node that runs as a process of its own, and what it has said."""

    def __init__(self, command: list[str], environment: Mapping[str, str], log: Path) -> None:
        self._log = log
        with log.open('wb') as output:
            self._process = subprocess.Popen(
                command,
                env=dict(environment),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=functools.partial(end_with, os.getpid()),
            )

    @property
    def name(self) -> str:
        """Return the name of its log, which has the node and the order of the starts."""
        return self._log.stem

    @property
    def log(self) -> str:
        """What it has written to its standard output and error."""
        return self._log.read_text(errors='replace')

    @property
    def status(self) -> int | None:
        """Exit status, None while it runs."""
        return self._process.poll()

    def wait(self) -> int:
        """Wait for its end; return the exit status."""
        return self._process.wait(DEADLINE_S)

    def send(self, number: int) -> None:
        """Send a signal."""
        self._process.send_signal(number)

    def stop(self, number: int = signal.SIGINT) -> int:
        """Send a signal; return the exit status."""
        self.send(number)
        return self.wait()

    def kill(self) -> None:
        """End it for certain."""
        self._process.kill()
        self._process.wait()


class Graph:
    """A ROS domain of its own, a node of the test in it, and the processes started there."""

    def __init__(self, domain: int, folder: Path) -> None:
        self._folder = folder
        self._processes: list[NodeProcess] = []
        self._environment = os.environ | {
            'ROS_DOMAIN_ID': str(domain),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        }
        self._context = Context()
        rclpy.init(
            context=self._context,
            domain_id=domain,
            signal_handler_options=SignalHandlerOptions.NO,
        )
        self.node = Node('test', context=self._context, enable_rosout=False)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    @property
    def logs(self) -> str:
        """What the processes have said, one after the other, with their exit status."""
        said = (f'{process.name}, {process.status}:\n{process.log}' for process in self._processes)
        return '\n'.join(said)

    def start(
        self,
        executable: str,
        parameters: Mapping[str, Any] | None = None,
        *arguments: str,
        run_by: Sequence[str] = (),
    ) -> NodeProcess:
        """Start a node with parameters and further arguments for ROS.

        It is run by its executable, where no other command is given.
        """
        command = [*(run_by or [str(find_executable(executable))]), '--ros-args', *arguments]
        for name, value in (parameters or {}).items():
            command += ['-p', f'{name}:={value}']
        log = self._folder / f'{executable}-{len(self._processes)}.log'
        process = NodeProcess(command, self._environment, log)
        self._processes.append(process)
        return process

    def until(self, condition: Callable[[], Any], what: str = 'the condition') -> Any:
        """Spin until a condition is true; return its value."""
        deadline_s = time.monotonic() + DEADLINE_S
        while not (value := condition()):
            if time.monotonic() > deadline_s:
                pytest.fail(f'waited {DEADLINE_S:g} s for {what}')
            self._executor.spin_once(timeout_sec=TURN_S)
        return value

    def result(self, future: Any) -> Any:
        """Spin until a future is done; return its result."""
        self.until(future.done, 'an answer')
        return future.result()

    def call(self, kind: type, name: str, **fields: Any) -> Any:
        """Call a service once; return the response."""
        client = self.node.create_client(kind, name)
        self._be_met(name.rpartition('/')[0])
        self.until(client.service_is_ready, f'service {name}')
        response = self.result(client.call_async(kind.Request(**fields)))
        self.node.destroy_client(client)
        return response

    def _be_met(self, node: str) -> None:
        """Wait until a node has met the clients that have been made so far.

        A service drops its answer to a client that it has not met within 0.1 s, and a request may
        not be one that can be made twice. The client of a harmless request, which is made last
        and is therefore met last, asks again until it is answered.
        """
        client = self.node.create_client(ListParameters, f'{node}/list_parameters')
        self.until(client.service_is_ready, f'node {node}')
        answer, asked_s = client.call_async(ListParameters.Request()), time.monotonic()

        def is_answered() -> bool:
            nonlocal answer, asked_s
            if not answer.done() and time.monotonic() - asked_s > ASK_AGAIN_S:
                client.remove_pending_request(answer)
                answer, asked_s = client.call_async(ListParameters.Request()), time.monotonic()
            return answer.done()

        self.until(is_answered, f'an answer of node {node}')
        self.node.destroy_client(client)

    def close(self) -> None:
        """End everything."""
        for process in self._processes:
            process.kill()
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, Any, Any]:
    """Show with a failure what the nodes of its graph said; their logs are gone afterwards."""
    report = yield
    nodes = getattr(item, 'funcargs', {}).get('graph')
    if report.failed and hasattr(nodes, 'logs'):
        report.sections.append(('the nodes, their exit status, and what they said', nodes.logs))
    return report


@pytest.fixture(scope='module')
def graph(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Graph]:
    """Give the module's tests a graph that they share."""
    with pytest.MonkeyPatch.context() as patch, domain_id() as domain:
        # The test's own node reads it, and must see the processes.
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        graph = Graph(domain, tmp_path_factory.mktemp('graph'))
        try:
            yield graph
        finally:
            graph.close()
