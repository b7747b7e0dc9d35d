"""One action of many environments, compiled: steps that hold it, and what is seen of them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.compiled import inner
from spikelane_sim.encoding import count_cells, EncodingParameters
from spikelane_sim.fleet.kernel import simulate
from spikelane_sim.kernel_arrays import borrowed

_MOST_COUNTED = 255


class Cells(NamedTuple):
    """Cells of the image with events; rows are robots.

    Attributes:
        crop_top: Rows of pixels left out at the top.
        side: Side of a cell [px].
        frames: Last steps that count.
        counts: Events of the last step, (n_robots, rows, columns).
        last_seen: Steps of the robot's life when each cell last had an event, 0 for never,
            (n_robots, rows, columns).
        now: Steps of the robot's life, (n_robots,).
    """

    crop_top: int
    side: int
    frames: int
    counts: NDArray[np.int64]
    last_seen: NDArray[np.int64]
    now: NDArray[np.int64]


class Places(NamedTuple):
    """Where events were in the last steps; rows are robots.

    Attributes:
        places: Column + width (row + height, for OFF), each once in a step,
            (n_robots, frames, 2 * height * width); memory is taken where there are events.
        times: How many events each place of the image had in a step, at most 255; of the same
            shape.
        number: How many of the places count in each step, (n_robots, frames).
        oldest: Which of the steps is the oldest, (n_robots,).
    """

    places: NDArray[np.int32]
    times: NDArray[np.uint8]
    number: NDArray[np.int64]
    oldest: NDArray[np.int64]


def make_cells(n_robots: int, encoding: EncodingParameters, frames: int) -> Cells:
    """Return cells that have seen nothing."""
    shape = (n_robots, encoding.rows, encoding.columns)
    return Cells(
        encoding.crop_top,
        encoding.cell,
        frames,
        np.zeros(shape, np.int64),
        np.zeros(shape, np.int64),
        np.zeros(n_robots, np.int64),
    )


def make_places(n_robots: int, frames: int, pixels: int) -> Places:
    """Return places without events, for an image of so many pixels."""
    shape = (n_robots, frames, 2 * pixels)
    return Places(
        np.empty(shape, np.int32),
        np.zeros(shape, np.uint8),
        np.zeros((n_robots, frames), np.int64),
        np.zeros(n_robots, np.int64),
    )


@numba.njit(cache=True, nogil=True)
def hold(  # type: ignore[no-untyped-def]
    world, robots, scratch, template, cells, places, wheels, is_driving, steps, first, last
):
    """Let robots first to last drive for some steps, or until their episode ends.

    Args:
        world: The `World`.
        robots: The `Robots`.
        scratch: A `Scratch` of this thread.
        template: `generators.TEMPLATE`.
        cells: Are brought up to date.
        places: The same, where there is room for any.
        wheels: Velocities asked of the wheels [rad/s], (n_robots, 2).
        is_driving: Which robots drive, (n_robots,).
        steps: How many steps.
        first: First of the robots.
        last: The robot after the last one.
    """
    world, robots, scratch = borrowed(world), borrowed(robots), borrowed(scratch)
    cells, places = borrowed(cells), borrowed(places)
    for i in range(first, last):
        if not is_driving[i]:
            continue
        for _ in range(steps):
            events = simulate(world, robots, scratch, template, i, wheels[i, 0], wheels[i, 1])
            _count(cells, events, len(events), i)
            if places.places.shape[2] > 0:
                _put(places, world, events, len(events), i)
            if robots.known[i].reason > 0:
                break


@inner
def _count(cells, events, number, i):  # type: ignore[no-untyped-def]
    counts, last_seen = cells.counts[i], cells.last_seen[i]
    count_cells(events, number, cells.crop_top, cells.side, counts)
    cells.now[i] += 1
    for row in range(counts.shape[0]):
        for column in range(counts.shape[1]):
            if counts[row, column] > 0:
                last_seen[row, column] = cells.now[i]


@inner
def _put(places, world, events, number, i):  # type: ignore[no-untyped-def]
    oldest = places.oldest[i]
    row, times = places.places[i, oldest], places.times[i, oldest]
    for k in range(places.number[i, oldest]):
        times[row[k]] = 0
    found = 0
    for k in range(number):
        y = np.int64(events[k].y)
        if events[k].polarity <= 0:
            y += world.height
        place = y * world.width + np.int64(events[k].x)
        if times[place] == 0:
            row[found] = place
            found += 1
        if times[place] < _MOST_COUNTED:
            times[place] += 1
    places.number[i, oldest] = found
    places.oldest[i] = (oldest + 1) % places.number.shape[1]


def forget(cells: Cells, places: Places, robot: int) -> None:
    """Begin an episode: a robot has seen nothing."""
    cells.counts[robot] = 0
    cells.last_seen[robot] = 0
    cells.now[robot] = cells.frames  # so that a cell that was never seen counts for none of them
    for frame, number in enumerate(places.number[robot].tolist()):
        places.times[robot, frame, places.places[robot, frame, :number]] = 0
    places.number[robot] = 0


def state_images(cells: Cells) -> NDArray[np.uint8]:
    """Return 1 where a cell had an event in the last steps, (n_robots, rows, columns)."""
    since = (cells.now - cells.frames)[:, None, None]
    return (cells.last_seen > since).astype(np.uint8)


def event_images(places: Places, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return the numbers of events in the last steps, at most 255.

    Args:
        places: Where events were.
        shape: Shape of the image: polarities, height and width.
    """
    images = np.zeros((len(places.oldest), *shape), np.uint8)
    _draw(places, images.reshape(len(images), -1))
    return images


@numba.njit(cache=True)
def _draw(places: Any, images: NDArray[np.uint8]) -> None:
    for i in range(images.shape[0]):
        image = images[i]
        for frame in range(places.number.shape[1]):
            row, times = places.places[i, frame], places.times[i, frame]
            for k in range(places.number[i, frame]):
                place = row[k]
                seen = np.int64(image[place]) + np.int64(times[place])
                image[place] = min(seen, _MOST_COUNTED)
