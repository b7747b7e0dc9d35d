"""What tests of several processes share."""

from collections.abc import Callable, Iterator
import contextlib
from pathlib import Path
import subprocess

import pytest

from spikelane.executables import find_executable


@pytest.fixture(scope='session')
def every_step() -> tuple[str, ...]:
    """Topics with a message in the bag for each observation, the first one included."""
    return (
        '/clock',
        '/controller/state',
        '/event_camera/events',
        '/ground_truth/odom',
        '/lane/distance',
        '/lane/state',
        '/tf',
        '/wheel_velocities',
    )


@pytest.fixture
def second_node(
    tmp_path: Path,
) -> Callable[[str, int], contextlib.AbstractContextManager[None]]:
    """Run a node, named `intruder`, in the ROS domain of a process, while a block is executed."""

    @contextlib.contextmanager
    def run(executable: str, process_id: int) -> Iterator[None]:
        environment = Path(f'/proc/{process_id}/environ').read_bytes()
        variables = dict(pair.split('=', 1) for pair in environment.decode().split('\0') if pair)
        words = [str(find_executable(executable)), '--ros-args', '-r', '__node:=intruder']
        with (tmp_path / 'intruder').open('wb') as output:
            process = subprocess.Popen(words, env=variables, stdout=output, stderr=output)
        try:
            yield
        finally:
            process.kill()
            process.wait()

    return run
