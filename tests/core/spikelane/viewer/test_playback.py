"""Recorded bags in the viewer: what is sent of them, read back with Rerun's own reader."""

from __future__ import annotations

import io
import json
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import time
from typing import Any

import numpy as np
from PIL import Image
from playwright.sync_api import sync_playwright
import pytest
import rerun
from rerun.recording import load_recording

from spikelane.bag.drive import RecordedDrive
from spikelane.viewer.playback import bag_of, play, Played
from spikelane.viewer.scene import Scene
from spikelane_sim.errors import BagError

DATA = Path(__file__).parents[3] / 'data'
STEP_S = 0.05

#: WebGL without a graphics card.
BROWSER = ('--enable-unsafe-swiftshader', '--use-angle=swiftshader', '--no-sandbox')


def played(bag: Path, folder: Path, **how: Any) -> tuple[Played, dict[str, dict[float, Any]]]:
    """Return what came of playing a bag, and what was sent, by entity and component."""
    file = folder / 'scene.rrd'
    recording = rerun.RecordingStream('spikelane', recording_id='test')
    recording.save(file)
    result = play(RecordedDrive(bag), Scene(recording, is_recorded=True), **how)
    recording.flush()
    found: dict[str, dict[float, Any]] = {}
    for chunk in load_recording(file).chunks():
        if chunk.is_static:
            continue
        batch = chunk.to_record_batch()
        if 'simulation' not in batch.schema.names:
            continue
        times = batch.column('simulation').to_numpy(zero_copy_only=False).astype('int64') / 1e9
        for name in batch.schema.names:
            values = zip(times.tolist(), batch.column(name).to_pylist(), strict=True)
            found.setdefault(f'{chunk.entity_path} {name}', {}).update(
                {round(at_s, 6): value for at_s, value in values if value is not None}
            )
    return result, found


def first_image(found: dict[str, dict[float, Any]]) -> Image.Image:
    """Return the first of the camera's images."""
    (contents,) = next(iter(found['/camera/image EncodedImage:blob'].values()))
    return Image.open(io.BytesIO(bytes(contents)))


def test_every_step_of_a_drive_is_shown(
    tmp_path: Path, drives: Any, braitenberg_drive: list[Any]
) -> None:
    """Each episode's simulation time begins anew or goes on; on the page it goes on."""
    seen = drives.drive('braitenberg', seed=5, episodes=(10, 8), from_time_zero=True)
    bag = drives.write(tmp_path / 'bag', drives.say(seen), facts={'scenario': '2'})
    result, found = played(bag, tmp_path)
    assert (result.steps, result.notes) == (20, ())
    distances = found['/lane/distance Scalars:scalars']
    steps = range(1, 21)  # the first observation has been driven up to 50 ms
    assert list(distances) == pytest.approx([STEP_S * step for step in steps])
    assert [value for [value] in distances.values()] == [
        each.observation.lane.distance_m for each in seen
    ]
    # The second episode's curve is a line of its own.
    assert len(found['/lane/distance Clear:is_recursive']) == 1
    events = found['/camera/events Points2D:positions']
    assert [len(points) for points in events.values()] == [
        len(each.observation.events) for each in seen
    ]
    picture = first_image(found)
    assert (picture.format, picture.size) == ('PNG', (128, 128))


def test_the_time_that_was_lost_is_a_gap(
    tmp_path: Path, drives: Any, braitenberg_drive: list[Any]
) -> None:
    """Two of thirty steps lack: the curve ends before them and begins after them."""
    seen = [each for number, each in enumerate(braitenberg_drive[:30]) if number not in (11, 12)]
    _, found = played(drives.write(tmp_path / 'bag', drives.say(seen)), tmp_path)
    before_s = seen[10].observation.stamp_ns / 1e9
    assert list(found['/lane/distance Clear:is_recursive']) == [
        pytest.approx(before_s + STEP_S / 2)
    ]


@pytest.mark.parametrize(
    ('bag', 'size'), [('bag_none', (128, 128)), ('cameras/plain.mcap', (1280, 720))]
)
def test_a_real_camera_s_recording_is_shown(
    tmp_path: Path, bag: str, size: tuple[int, int]
) -> None:
    """All of its image, from 50 ms on, whatever its clock says."""
    result, found = played(DATA / bag, tmp_path)
    images = found['/camera/image EncodedImage:blob']
    assert first_image(found).size == size
    assert min(images) == STEP_S
    assert len(images) == result.steps > 2
    assert '/lane/distance Scalars:scalars' not in found


def test_a_later_part_is_shown_and_no_more_than_fits(
    tmp_path: Path, drives: Any, braitenberg_drive: list[Any]
) -> None:
    """And it is said where it ends."""
    bag = drives.write(tmp_path / 'bag', drives.say(braitenberg_drive[:30]))
    result, found = played(bag, tmp_path, start_s=1.0)
    assert result.steps == 10
    assert len(found['/camera/events Points2D:positions']) == 10
    result, _ = played(bag, tmp_path, most_bytes=1)
    assert result.steps == 1
    assert 'shown until 0.0 s, as more would not fit; --start shows later parts' in result.notes
    with pytest.raises(BagError, match='expected steps after 99 s, got none'):
        played(bag, tmp_path, start_s=99.0)


def test_the_bag_of_a_lap_s_folder_is_found(tmp_path: Path) -> None:
    """A folder with a configuration is a run, and its bag is read; any other path is a bag."""
    (tmp_path / 'bag').mkdir()
    assert bag_of(tmp_path) == tmp_path
    (tmp_path / 'config.yaml').touch()
    assert bag_of(tmp_path) == tmp_path / 'bag'


@pytest.mark.slow
def test_a_browser_plays_a_bag(tmp_path: Path, drives: Any, chromium: str) -> None:
    """By the command: the robot is on the course, and moves; Ctrl-C ends it."""
    seen = drives.drive('braitenberg', seed=5, episodes=(400,))
    bag = drives.write(tmp_path / 'bag', drives.say(seen), facts={'scenario': '1'})
    command = [sys.executable, '-m', 'spikelane.main', 'view', str(bag), '--json']
    with (tmp_path / 'errors').open('w') as errors:
        process = subprocess.Popen(
            [*command, '--port', '0', '--data-port', '0'],
            stdout=subprocess.PIPE,
            stderr=errors,
            start_new_session=True,
        )
    try:
        assert process.stdout is not None
        said = json.loads(process.stdout.readline())
        assert (said['steps'], said['notes']) == (401, [])
        said_so_far = (tmp_path / 'errors').read_text()
        url = re.findall(r'^open (\S+) in a browser$', said_so_far, re.M)[0]
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=chromium, args=list(BROWSER))
            page = browser.new_page(viewport={'width': 1400, 'height': 900})
            page.goto(url)
            places: set[tuple[int, int]] = set()
            deadline_s = time.monotonic() + 120
            while len(places) < 2 and time.monotonic() < deadline_s:
                page.wait_for_timeout(1000)
                picture = np.asarray(Image.open(io.BytesIO(page.screenshot(timeout=60_000))))
                yellow = (np.abs(picture[..., :3].astype(int) - (240, 228, 66)) < 12).all(-1)
                if yellow.sum() >= 30:
                    rows, columns = np.nonzero(yellow)
                    places.add((int(rows.mean()), int(columns.mean())))
            browser.close()
        assert len(places) == 2
        os.killpg(process.pid, signal.SIGINT)
        assert process.wait(60) == 0
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
