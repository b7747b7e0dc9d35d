"""`spikelane view`: a robot drives, real clients look on."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import csv
import functools
import io
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import time
from typing import Any, NamedTuple

import numpy as np
from PIL import Image
import pytest

from spikelane.processes import end_with

pytestmark = pytest.mark.ros

STEPS = 600
DEADLINE_S = 200.0
STEP_NS = 50_000_000
DRIVING = ('--controller', 'rstdp', '--robot', 'kinematic', '--seed', '3')
LIMIT = ('--param', f'simulator.episode.max_steps={STEPS}')
#: WebGL without a graphics card; and no other machine can be reached.
BROWSER = (
    '--enable-unsafe-swiftshader',
    '--use-angle=swiftshader',
    '--no-sandbox',
    '--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1',
)

#: By entity, component and time [ns].
Shown = Callable[[str, Path], dict[str, dict[str, dict[int, Any]]]]


class View(NamedTuple):
    """The command, at work, when the robot has driven."""

    process: subprocess.Popen
    url: str
    address: str
    folder: Path

    def end(self) -> int:
        """Press Ctrl-C; return the exit status."""
        os.killpg(self.process.pid, signal.SIGINT)
        return self.process.wait(DEADLINE_S)


@contextlib.contextmanager
def viewing(folder: Path, *what: str) -> Iterator[View]:
    """Run the command until it waits for Ctrl-C.

    Args:
        folder: Folder of its output.
        what: Is done before the viewer's eyes.
    """
    command = [sys.executable, '-m', 'spikelane.main', 'view', '--port', '0', '--data-port', '0']
    errors = folder / 'errors'
    with errors.open('wb') as output:
        process = subprocess.Popen(
            [*command, *DRIVING, *(what or LIMIT), '--out', str(folder / 'run')],
            stdout=subprocess.DEVNULL,
            stderr=output,
            start_new_session=True,
            preexec_fn=functools.partial(end_with, os.getpid()),
        )
    try:
        deadline_s = time.monotonic() + DEADLINE_S
        while 'Ctrl-C ends' not in errors.read_text():
            assert time.monotonic() < deadline_s, errors.read_text()
            assert process.poll() is None, errors.read_text()
            time.sleep(0.1)
        url = re.findall(r'^open (\S+) in a browser$', errors.read_text(), re.M)[0]
        port = re.findall(r'127\.0\.0\.1%3A(\d+)', url)[0]
        yield View(process, url, f'rerun+http://127.0.0.1:{port}/proxy', folder / 'run')
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


@pytest.fixture(scope='module')
def view(tmp_path_factory: pytest.TempPathFactory) -> Iterator[View]:
    """Give a command whose robot has driven."""
    with viewing(tmp_path_factory.mktemp('view')) as view:
        yield view


def rows(file: Path) -> dict[int, dict[str, str]]:
    """Return the rows of a trajectory by their time [ns]."""
    with file.open() as lines:
        return {STEP_NS * (k + 1): row for k, row in enumerate(csv.DictReader(lines))}


def test_what_a_client_receives_is_what_was_driven(
    view: View, tmp_path: Path, shown_at: Shown
) -> None:
    """Distances and places at their times; events, spikes, weights and the course are there."""
    shown = shown_at(view.address, tmp_path / 'received.rrd')
    driven = rows(view.folder / 'trajectory.csv')
    assert len(driven) == STEPS + 1
    distances = shown['/lane/distance']['Scalars:scalars']
    # How many were looked at depends on how busy the machine is.
    assert distances
    for stamp_ns, [distance_m] in distances.items():
        assert distance_m == float(driven[stamp_ns]['distance_m'])
    for stamp_ns, [[x_m, y_m]] in shown['/course/robot']['Arrows2D:origins'].items():
        # Positions are sent in single precision.
        assert x_m == pytest.approx(float(driven[stamp_ns]['x_m']), abs=1e-5)
        assert y_m == pytest.approx(-float(driven[stamp_ns]['y_m']), abs=1e-5)
    assert {'/camera/events', '/camera/image', '/course/path', '/course/markings'} <= shown.keys()
    assert {'/controller/spikes/left', '/controller/spikes/right'} <= shown.keys()
    assert '/controller/weights/weights' in shown


def test_being_watched_changes_nothing(view: View, tmp_path: Path) -> None:
    """The trajectory is that of the lap driven in one process, to the last bit."""
    command = [sys.executable, '-m', 'spikelane.main', 'lap', '--transport', 'inprocess']
    alone = tmp_path / 'alone'
    subprocess.run([*command, *DRIVING, *LIMIT, '--out', str(alone)], capture_output=True)
    watched = (view.folder / 'trajectory.csv').read_bytes()
    assert watched == (alone / 'trajectory.csv').read_bytes()


def test_a_browser_shows_it_without_a_network(view: View, chromium: str) -> None:
    """Headless Chromium: the page comes up by itself, with the robot on the course."""
    sync_api = pytest.importorskip('playwright.sync_api')
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=list(BROWSER))
        page = browser.new_page(viewport={'width': 1400, 'height': 900})
        page.goto(view.url)
        yellow, deadline_s = 0, time.monotonic() + 120
        while yellow < 50 and time.monotonic() < deadline_s:
            page.wait_for_timeout(2000)
            picture = np.asarray(Image.open(io.BytesIO(page.screenshot(timeout=60_000))))
            # The robot's colour, and that of nothing else.
            yellow = int(
                (np.abs(picture[..., :3].astype(int) - (240, 228, 66)) < 12).all(-1).sum()
            )
        browser.close()
    assert yellow >= 50


def test_a_training_is_shown_and_is_the_one_that_nobody_watched(
    tmp_path: Path, shown_at: Shown
) -> None:
    """Rewards and weights are there; the checkpoint is that of the training in one process."""
    learning = ('--train', '--steps', str(STEPS))
    with viewing(tmp_path, *learning) as view:
        shown = shown_at(view.address, tmp_path / 'received.rrd')
        assert view.end() == 0
    stamps = {STEP_NS * (step + 1) for step in range(STEPS + 1)}
    distances = shown['/lane/distance']['Scalars:scalars']
    assert distances.keys()
    assert distances.keys() <= stamps
    assert shown['/controller/reward']['Scalars:scalars']
    weights = list(shown['/controller/weights/weights']['Image:buffer'].values())
    assert weights[0] != weights[-1]  # it learnt
    command = [sys.executable, '-m', 'spikelane.main', 'train', 'rstdp', '--transport']
    alone = [*command, 'inprocess', *DRIVING[2:], '--steps', str(STEPS), '--out']
    subprocess.run([*alone, str(tmp_path / 'alone')], capture_output=True, check=True)
    for name in ('checkpoint.safetensors', 'checkpoint.json', 'episodes.csv'):
        watched = (view.folder / name).read_bytes()
        assert watched == (tmp_path / 'alone' / name).read_bytes()


def test_ctrl_c_ends_it_and_the_server(tmp_path: Path) -> None:
    """Exit status 0, one process after the other; nobody listens any more."""
    with viewing(tmp_path) as view:
        [server] = [
            int(path.name)
            for path in Path('/proc').glob('[0-9]*')
            if f'\0{view.address.split(":")[2].split("/")[0]}\0' in _command_of(path)
        ]
        assert view.end() == 0
        assert not Path('/proc', str(server)).exists()
    errors = (tmp_path / 'errors').read_text()
    assert 'Traceback' not in errors


def _command_of(process: Path) -> str:
    try:
        return (process / 'cmdline').read_text()
    except OSError:
        return ''
