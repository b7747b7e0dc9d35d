"""One robot of a fleet through one step, compiled.

What happens in a step is what `Simulator.step` does, in the same order and with the same
functions: the command is admitted and carried, the robot moves, is located, its progress is
followed, and what its camera sees becomes events, which filters let pass. Robots share a `World`,
and whatever changes is in row i of the arrays of `Robots`, so that robots can be simulated in any
order and on any thread.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.bit_planes import fire_planes, render_planes
from spikelane_sim.compiled import copy, inlined, inner, uncounted
from spikelane_sim.curve import nearest_on_curve
from spikelane_sim.episode_rules import (
    admit,
    CLIPPED,
    follow,
    heading_of,
    NOT_FINITE,
    Progress,
    start_at,
)
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.events import EVENT_DTYPE, Events
from spikelane_sim.filters.compiled import filter_events
from spikelane_sim.fleet.bodies import move_body
from spikelane_sim.fleet.conditions import Conditions, with_rates
from spikelane_sim.fleet.generators import generator_at
from spikelane_sim.fleet.world import OTHER, RIGID_ENGINE
from spikelane_sim.pixels.coppelia import fire
from spikelane_sim.pixels.crossings import cross_image, Crossings, deliver, emit, PixelArrays
from spikelane_sim.pixels.dead import keep_living
from spikelane_sim.pixels.esim import make_crossings
from spikelane_sim.raster import render
from spikelane_sim.robots.kinematic import drive_arc
from spikelane_sim.robots.rigid import drive_step
from spikelane_sim.robots.wheel_errors import nominal_velocities, WheelErrors

#: What is known of a robot: its course and lane, where it is on it, and what became of commands.
ROBOT_DTYPE = np.dtype(
    [
        ('course', '<i8'),
        ('lane', '<i8'),  # of all lanes of all courses
        ('distance_m', '<f8'),
        ('heading_error_rad', '<f8'),
        ('section', '<i8'),  # of the lane
        ('position_m', '<f8'),  # this and the next six: see `episode_rules.Progress`
        ('progress_m', '<f8'),
        ('laps', '<i8'),
        ('step', '<i8'),
        ('furthest_m', '<f8'),
        ('furthest_step', '<i8'),
        ('reason', '<i8'),
        ('not_finite', '<i8'),  # commands
        ('clipped', '<i8'),  # commands
        ('n_waiting', '<i8'),  # rows of `Robots.waiting` that count
        ('n_events', '<i8'),  # in the last step, before the filters
        ('sent', '<i8'),  # commands of the episode
        ('arrived', '<i8'),  # of these
    ]
)

#: Columns of `Robots.motion` with the engine rigid; with kinematic v and w are the velocities of
#: the wheels. With an engine that is not compiled only the first three count.
X, Y, HEADING, FORWARD, TURN, LEFT, RIGHT = range(7)


class Robots(NamedTuple):
    """What changes; rows are robots.

    Attributes:
        known: Records of `ROBOT_DTYPE`, (n_robots,).
        motion: x, y [m], heading [rad], v [m/s], w [rad/s] and the wheels' angles [rad],
            (n_robots, 7).
        bodies: `Bodies.numbers`; 0 with a compiled engine, (n_robots,).
        poses: Poses of the body at the images of the last step, (n_robots, n_images, 7).
        planes: What was seen last, (n_robots, 2, height, words); of no size without bit planes.
        reference: Reference of the pixels, (n_robots, height * width); of no size
            with bit planes and with `esim`.
        change: The same.
        esim: What the pixels of `esim` are and remember, (n_robots, height * width) each; None
            without.
        waiting: Events of `esim` of times still to come, (n_robots, room).
        memory: What the filters remember, (n_robots, n_numbers).
        commands: The last ones sent [rad/s], number n in row n % rows, (n_robots, rows, 2).
        conditions: What changes from robot to robot and episode to episode.
        noise: Addresses of the generators that noise comes from, (n_robots,).
        losses: The same of the generators that losses are drawn from.
    """

    known: NDArray[np.void]
    motion: NDArray[np.float64]
    bodies: NDArray[np.int64]
    poses: NDArray[np.float64]
    planes: NDArray[np.uint64]
    reference: NDArray[np.float64]
    change: NDArray[np.float64]
    esim: PixelArrays | None
    waiting: Events
    memory: NDArray[np.int64]
    commands: NDArray[np.float64]
    conditions: Conditions
    noise: NDArray[np.uintp]
    losses: NDArray[np.uintp]


class Scratch(NamedTuple):
    """Arrays that a thread needs while it simulates robots one after the other."""

    image: NDArray[np.float32]  # (height, width), or of no size with bit planes
    planes: NDArray[np.uint64]  # (2, height, words)
    events: Events  # (height * width,)
    polarity: NDArray[np.int8]  # of the events of a step; 0 between steps, (height * width,)
    crossings: Crossings | None  # of `esim`; None without


def make_scratch(world: Any) -> Scratch:
    """Return arrays for one thread."""
    size = world.height * world.width
    side = 0 if world.has_planes else 1
    return Scratch(
        np.empty((side * world.height, side * world.width), np.float32),
        np.empty((2, world.height, -(-world.width // 64)), np.uint64),
        np.empty(size, EVENT_DTYPE),
        np.zeros(size, np.int8),
        make_crossings(size) if world.esim else None,
    )


@numba.njit(cache=True)
def begin(world, robots, scratch, i, x_m, y_m, heading_rad):  # type: ignore[no-untyped-def]
    """Place robot i at rest on the lane that is known of it, and let it see its first image.

    Where its engine is not compiled, it has been placed already, and its last pose is there.
    With `esim` the image is in `scratch.image`, for the pixels to look at.
    """
    motion, pose = robots.motion[i], robots.poses[i, -1]
    motion[:] = 0.0
    motion[X], motion[Y], motion[HEADING] = x_m, y_m, heading_rad
    if world.engine != OTHER:
        pose[:] = 0.0
        pose[0], pose[1] = x_m, y_m
        pose[2] = world.body.height_m if world.engine == RIGID_ENGINE else world.drive.height_m
        pose[5], pose[6] = np.sin(heading_rad / 2), np.cos(heading_rad / 2)
    known = robots.known[i]
    known.sent = known.arrived = known.n_waiting = known.n_events = 0
    copy(world.filters.memory, robots.memory[i])
    position_m = _locate(world, robots, i)
    _know(known, start_at(position_m))
    condition = robots.conditions.numbers[i, 0]
    _render(world, robots, scratch, i, 0, pose)
    if world.esim is not None:
        return
    if world.has_planes:
        copy(scratch.planes.ravel(), robots.planes[i].ravel())
        return
    seen, reference, change = scratch.image.ravel(), robots.reference[i], robots.change[i]
    for pixel in range(seen.size):
        now = np.float64(seen[pixel])
        reference[pixel] = now
        change[pixel] = condition.threshold * (now if now != 0.0 else world.dark_intensity)


@inner
def simulate(  # type: ignore[no-untyped-def]
    world, robots, scratch, template, i, left, right
):
    """Drive robot i for a step; return the events that reach its controller.

    Args:
        world: The `World`.
        robots: The `Robots`; row i changes.
        scratch: A `Scratch` of this thread.
        template: `generators.TEMPLATE`.
        i: Which robot.
        left: Velocity asked of the left wheel [rad/s].
        right: The same for the right wheel.

    Raises:
        SpikelaneError: More events wait for the latency of the pixels than there is room for.
    """
    known, limit = robots.known[i], world.max_wheel_velocity_rad_s
    left, right, became = admit(left * world.speed, right * world.speed, limit)
    known.not_finite += became == NOT_FINITE
    known.clipped += became == CLIPPED
    step = robots.conditions.step[i]
    phase = 1 if step > 0 and known.step + 1 >= step else 0
    condition = robots.conditions.numbers[i, phase]
    left, right = _carry(known, robots.commands[i], condition.latency_steps, left, right)
    if world.has_wheel_errors:
        errors = WheelErrors(condition.left, condition.right, condition.track)
        left, right = nominal_velocities(left, right, errors)
    _move(world, robots, i, left, right)
    position_m = _locate(world, robots, i)
    last = Progress(
        known.position_m,
        known.progress_m,
        known.laps,
        known.step,
        known.furthest_m,
        known.furthest_step,
        known.reason,
    )
    length_m = world.lengths_m[known.lane]
    _know(known, follow(length_m, world.limits, last, position_m, known.distance_m))
    events = _look(world, robots, scratch, template, i, phase, world.esim)
    if world.has_dead:
        events = events[: keep_living(robots.conditions.dead[i, phase], world.width, events)]
    if condition.event_loss > 0.0:
        rng = generator_at(template, robots.losses[i])
        events = events[: _lose(rng, events, len(events), condition.event_loss)]
    known.n_events = len(events)
    if len(world.filters.does) > 0:
        events = events[: filter_events(world.filters, robots.memory[i], events)]
    return events


@uncounted
def _know(known, progress):  # type: ignore[no-untyped-def]
    """Write down a `Progress`."""
    known.position_m, known.progress_m = progress.position_m, progress.progress_m
    known.laps, known.step = progress.laps, progress.step
    known.furthest_m, known.furthest_step = progress.furthest_m, progress.furthest_step
    known.reason = progress.reason


@uncounted
def _carry(known, commands, latency_steps, left, right):  # type: ignore[no-untyped-def]
    """Send a command; return the one that arrives (`communication_link`)."""
    rows = commands.shape[0]
    if rows == 1:
        return left, right
    row = commands[known.sent % rows]
    row[0], row[1] = left, right
    known.sent += 1
    known.arrived = max(known.arrived, known.sent - latency_steps)
    if known.arrived == 0:
        return 0.0, 0.0
    last = commands[(known.arrived - 1) % rows]
    return last[0], last[1]


@inlined
def _move(world, robots, i, left, right):  # type: ignore[no-untyped-def]
    motion, poses = robots.motion[i], robots.poses[i]
    if world.engine == OTHER:
        move_body(robots.bodies[i], left, right, poses, motion[: HEADING + 1])
        return
    if world.engine == RIGID_ENGINE:
        drive_step(world.body, motion, left, right, world.substeps, poses)
        return
    drive = world.drive
    motion[FORWARD], motion[TURN] = left, right
    forward = (left + right) * drive.radius_m / 2
    turn = (right - left) * drive.radius_m / drive.track_m
    start = (motion[X], motion[Y], motion[HEADING])
    driven, x_m, y_m, heading_rad = drive_arc(
        start, forward, turn, drive.axle_x_m, drive.height_m, poses.shape[0], world.period_s
    )
    copy(driven.ravel(), poses.ravel())
    motion[X], motion[Y], motion[HEADING] = x_m, y_m, heading_rad
    motion[LEFT] += left * world.period_s
    motion[RIGHT] += right * world.period_s


@inner
def _locate(world, robots, i):  # type: ignore[no-untyped-def]
    """Find robot i on its lane; return its position along it [m]."""
    known, pose = robots.known[i], robots.poses[i, -1]
    heading_rad = heading_of(pose[3], pose[4], pose[5], pose[6])
    first, last = world.first_segment[known.lane], world.first_segment[known.lane + 1]
    distance_m, error_rad, position_m, section = nearest_on_curve(
        world.curves[first:last], pose[0], pose[1], heading_rad
    )
    known.distance_m, known.heading_error_rad, known.section = distance_m, error_rad, section
    return position_m


@inner
def _render(world, robots, scratch, i, phase, pose):  # type: ignore[no-untyped-def]
    """Draw what robot i sees from a pose."""
    condition, lens = robots.conditions.numbers[i, phase], robots.conditions.lens[i, phase]
    course = condition.markings
    pieces = world.pieces[world.first_piece[course] : world.first_piece[course + 1]]
    if world.has_planes:
        seen = robots.conditions.seen[i, phase]
        render_planes(pieces, seen[1] != seen[0], lens, pose, world.width, scratch.planes)
    else:
        floor, marking = condition.floor, condition.marking
        render(pieces, floor, marking, lens, pose, world.n_rows, scratch.image)


@inner
def _look(world, robots, scratch, template, i, phase, esim):  # type: ignore[no-untyped-def]
    """Return the events of what robot i sees in a step, with noise.

    Numba compiles only one of the two branches, as the type of `esim` says whether it is None.
    """
    if esim is None:
        return _see(world, robots, scratch, template, i, phase)
    return _see_changes(world, robots, scratch, template, i, phase)


@inlined
def _see(world, robots, scratch, template, i, phase):  # type: ignore[no-untyped-def]
    """Return the events of what robot i sees, with noise.

    Their time is that of the step's end since the episode began, as the filters want it.
    """
    known, condition = robots.known[i], robots.conditions.numbers[i, phase]
    _render(world, robots, scratch, i, phase, robots.poses[i, -1])
    end_ns = (known.step + 1) * world.period_ns
    if world.has_planes:
        intensities = robots.conditions.seen[i, phase]
        number = fire_planes(robots.planes[i], scratch.planes, intensities, end_ns, scratch.events)
    else:
        number = fire(
            scratch.image.ravel(),
            robots.reference[i],
            robots.change[i],
            condition.threshold,
            world.dark_intensity,
            end_ns,
            world.width,
            scratch.events,
        )
    if condition.noise_rate_hz > 0.0:
        rng = generator_at(template, robots.noise[i])
        rate_hz = condition.noise_rate_hz
        number = _add_noise(world, rate_hz, rng, scratch, number, known.step)
    return scratch.events[:number]


@inlined
def _see_changes(world, robots, scratch, template, i, phase):  # type: ignore[no-untyped-def]
    """Return the events of the images that robot i sees in a step with `esim`."""
    known, poses, rows = robots.known[i], robots.poses[i], robots.esim
    pixels = PixelArrays(
        rows.threshold_on[i],
        rows.threshold_off[i],
        rows.intensity[i],
        rows.log_intensity[i],
        rows.reference[i],
        rows.last_event_us[i],
    )
    crossings, count, seen_us = scratch.crossings, 0, 0.0
    step_us = world.period_ns // 1000
    for k in range(poses.shape[0]):
        _render(world, robots, scratch, i, phase, poses[k])
        time_us = (k + 1) * step_us / poses.shape[0]
        crossings, count = cross_image(
            scratch.image.ravel(),
            pixels,
            world.esim.dark_intensity,
            seen_us,
            time_us,
            crossings,
            count,
        )
        seen_us = time_us
    rng = generator_at(template, robots.noise[i])
    # Time since the episode began; its first observation took one step.
    start_us = known.step * step_us
    constants = with_rates(world.esim, robots.conditions.numbers[i, phase])
    events = emit(constants, pixels, crossings, count, rng, 0, step_us, start_us)
    if world.esim.latency_us == 0:
        return events
    waiting = robots.waiting[i]
    events, later = deliver(waiting[: known.n_waiting], events, (start_us + step_us) * 1000)
    if len(later) > len(waiting):
        raise SpikelaneError(
            'pixels.esim.latency_s: expected fewer events waiting than a fleet has room for'
        )
    for k in range(len(later)):
        waiting[k] = later[k]
    known.n_waiting = len(later)
    return events


@inlined
def _add_noise(world, rate_hz, rng, scratch, number, step):  # type: ignore[no-untyped-def]
    """Add noise where no pixel has fired, as `CoppeliaPixels` does; return how many events.

    The draws are those of `noise.draw_shot`, one by one.
    """
    size = world.width * world.height
    step_us = world.period_ns // 1000
    drawn = rng.poisson(rate_hz * size * step_us * 1e-6)
    if drawn == 0:
        return number
    rng.integers(0, step_us, drawn)
    pixels = rng.integers(0, size, drawn)
    polarity = 2 * rng.integers(0, 2, drawn) - 1
    rng.random(drawn)
    events, taken = scratch.events, scratch.polarity
    end_ns = (step + 1) * world.period_ns
    for k in range(number):
        taken[np.int64(events[k].y) * world.width + np.int64(events[k].x)] = events[k].polarity
    for k in range(drawn):
        if taken[pixels[k]] == 0:
            taken[pixels[k]] = polarity[k]
    # Events are in the order of rows, then columns.
    number = 0
    for y in range(world.height):
        row = taken[y * world.width : (y + 1) * world.width]
        for x in range(world.width):
            if row[x] != 0:
                event = events[number]
                event['t'], event['x'], event['y'], event['polarity'] = end_ns, x, y, row[x]
                row[x] = 0
                number += 1
    return number


@uncounted
def _copy(to, event):  # type: ignore[no-untyped-def]
    to['t'], to['x'], to['y'] = event.t, event.x, event.y
    to['polarity'] = event.polarity


@uncounted
def _lose(rng, events, number, event_loss):  # type: ignore[no-untyped-def]
    """Keep the events that reach the controller (`communication_link`); return how many."""
    kept = 0
    for k in range(number):
        if rng.random() >= event_loss:
            if kept != k:
                _copy(events[kept], events[k])
            kept += 1
    return kept
