"""`spikelane mask`: from a recording to the events that are left of it."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spikelane.main import run
from spikelane_sim.events import make_events
from spikelane_sim.filters.hot_pixels import HotPixels, write_hot_pixels


@pytest.fixture
def bag(drives: Any, bag_of: Any) -> Path:
    """Give half a second of noise, a third of whose events are of two hot pixels."""
    rng = np.random.default_rng(2)
    said = []
    for number in range(50):
        begin_ns = 10**9 + number * 10_000_000
        t_ns = np.sort(begin_ns + rng.integers(0, 10_000, 60) * 1000)
        x, y = rng.integers(0, 128, (2, 60))
        x[::6], y[::6] = 20, 30
        x[3::6], y[3::6] = 100, 127
        packet = drives.packet(make_events(t_ns, x, y, 1), begin_ns + 10_000_000, number, 'mono')
        object.__setattr__(packet, 'header', drives.header(2 * 10**9 + number * 10_000_000))
        said.append(drives.said('/event_camera/events', number * 10_000_000, packet))
    return bag_of(said)


def test_hot_pixels_of_a_recording_are_masked(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In a replay of the same recording the other events are left."""
    file = tmp_path / 'hot.json'
    assert run(['mask', str(bag), str(file), '--json']) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result['width'], result['height'], result['events']) == (128, 128, 3000)
    assert (result['hot_pixels'], result['events_of_hot_pixels']) == (2, 1001)  # one by chance
    assert json.loads(file.read_text())['pixels'] == [[20, 30], [100, 127]]
    given = ['filter.chain=hot_pixels', f'filter.hot_pixels.file={file}']
    options = [each for one in given for each in ('--param', one)]
    replay = ['replay', str(bag), '--controller', 'braitenberg', '--json', *options]
    assert run([*replay, '--out', str(tmp_path / 'replay')]) == 0
    assert json.loads(capsys.readouterr().out)['events']['passed'] == 1999


def test_a_search_that_is_not_possible_is_refused(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line, and no file."""
    file = tmp_path / 'hot.json'
    assert run(['mask', str(bag), str(file), '--param', 'rate=1']) == 2
    assert 'rate' in capsys.readouterr().err
    assert run(['mask', str(tmp_path / 'none'), str(file)]) != 0
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert not file.exists()


def test_another_mask_is_another_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An evaluation does not go on where the file of its mask has changed."""
    file = tmp_path / 'hot.json'
    write_hot_pixels(file, HotPixels(128, 128, np.array([[3, 4]])))
    given = [
        'simulator.episode.max_steps=3',
        'filter.chain=hot_pixels',
        f'filter.hot_pixels.file={file}',
    ]
    options = [each for one in given for each in ('--param', one)]
    common = ['evaluate', '--engine', 'kinematic', '--json', '--out', str(tmp_path / 'run')]
    assert run([*common, *options]) == 0
    assert run([*common, *options, '--resume']) == 0
    write_hot_pixels(file, HotPixels(128, 128, np.array([[3, 5]])))
    capsys.readouterr()
    assert run([*common, *options, '--resume']) == 2
    assert 'expected a run with' in capsys.readouterr().err
