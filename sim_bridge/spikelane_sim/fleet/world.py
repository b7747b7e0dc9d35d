"""What all robots of a fleet share, as numbers: courses, camera, robot, pixels, rules."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.bit_planes import fires_always
from spikelane_sim.camera import ANTIALIAS_ROWS, seen_ground
from spikelane_sim.conditions.schedule import Schedule
from spikelane_sim.course import Course
from spikelane_sim.filters import FilterParameters
from spikelane_sim.filters.compiled import Chain, make_chain
from spikelane_sim.pixels.crossings import Constants
from spikelane_sim.pixels.esim import esim_constants
from spikelane_sim.robots import KINEMATIC, RIGID
from spikelane_sim.robots.rigid import RigidBody, RigidDrive

#: Engines that are compiled, by the numbers that the kernel knows.
ENGINES = (KINEMATIC, RIGID)
RIGID_ENGINE = ENGINES.index(RIGID)

#: The number of all other engines, whose robots the kernel calls.
OTHER = len(ENGINES)

#: Where these change, what a pixel saw last does not follow from its last image.
_INTENSITIES = {'camera.contrast', 'pixels.coppelia.threshold'}


class Drive(NamedTuple):
    """An ideal differential drive, see `robots.kinematic`."""

    radius_m: float
    track_m: float
    axle_x_m: float
    height_m: float


class Limits(NamedTuple):
    """The fields of `EpisodeParameters`."""

    max_distance_m: float
    max_laps: int
    max_steps: int
    no_progress_steps: int
    min_progress_m: float


class World(NamedTuple):
    """All that is shared; courses and their lanes lie one after the other in flat arrays.

    Attributes:
        pieces: Markings, with the columns of `raster`, (n_pieces, 26).
        first_piece: First piece of each course, and the end of the last one's, (n_courses + 1,).
        curves: Centres of lanes, with the columns of `curve`, (n_segments, 8).
        first_segment: First segment of each lane, and the end of the last one's, (n_lanes + 1,).
        first_lane: First lane of each course, and the end of the last one's, (n_courses + 1,).
        lengths_m: Lengths of the lanes, (n_lanes,).
        starts: x, y [m] and heading [rad] where robots start on the lanes, (n_lanes, 3).
        n_rows: Scanlines per row of pixels.
        width: Columns of the image [px].
        height: Rows of the image [px].
        has_planes: Whether images are bit planes.
        engine: Index in `ENGINES`, or `OTHER`.
        drive: For the engine kinematic.
        body: For the engine rigid.
        substeps: Steps of the physics from one pose to the next.
        max_wheel_velocity_rad_s: The robot's limit.
        speed: Factor on all velocities asked of the wheels.
        limits: When an episode ends.
        dark_intensity: See `CoppeliaParameters`.
        esim: What the pixels of `esim` have in common; None with others, for which the kernel is
            compiled without them.
        n_images: Images that are rendered for a step.
        filters: Filters of the events.
        has_wheel_errors: Whether wheels are ever not as the robot takes them to be.
        has_dead: Whether pixels are ever dead.
        has_losses: Whether events are ever lost.
        most_latency_steps: The longest latency.
        most_noise_hz: The largest rate of noise of a pixel.
        most_esim_noise_hz: The same of leak and shot noise with `esim`.
        period_ns: Length of a step.
        period_s: The same.
    """

    pieces: NDArray[np.float64]
    first_piece: NDArray[np.int64]
    curves: NDArray[np.float64]
    first_segment: NDArray[np.int64]
    first_lane: NDArray[np.int64]
    lengths_m: NDArray[np.float64]
    starts: NDArray[np.float64]
    n_rows: int
    width: int
    height: int
    has_planes: bool
    engine: int
    drive: Drive
    body: RigidBody
    substeps: int
    max_wheel_velocity_rad_s: float
    speed: float
    limits: Limits
    dark_intensity: float
    esim: Constants | None
    n_images: int
    filters: Chain
    has_wheel_errors: bool
    has_dead: bool
    has_losses: bool
    most_latency_steps: int
    most_noise_hz: float
    most_esim_noise_hz: float
    period_ns: int
    period_s: float


def make_world(schedule: Schedule, courses: Sequence[Course], filters: FilterParameters) -> World:
    """Return what the robots of a fleet share.

    Args:
        schedule: Parameters of the simulation, whose course has no effect, and what changes.
        courses: On which the robots drive, or whose markings they see, at least one.
        filters: Filters of the events.

    Raises:
        SpikelaneError: A fleet cannot simulate this, or a filter cannot be made; the message
            names the parameter.
    """
    parameters = schedule.parameters
    n_images = parameters.pixels.images_per_step
    lanes = [lane for course in courses for lane in course.lanes.values()]
    camera, robot = parameters.camera, parameters.robot
    rules = parameters.episode
    rigid = RigidDrive(robot, n_images, parameters.period_s) if robot.engine == RIGID else None
    return World(
        pieces=np.concatenate([each.ground.pieces for each in courses]),
        first_piece=_bounds([len(each.ground.pieces) for each in courses]),
        curves=np.concatenate([lane.centre for lane in lanes]),
        first_segment=_bounds([len(lane.centre) for lane in lanes]),
        first_lane=_bounds([len(each.lanes) for each in courses]),
        lengths_m=np.array([lane.length_m for lane in lanes]),
        starts=np.array([lane.start for lane in lanes]),
        n_rows=ANTIALIAS_ROWS if camera.antialias else 1,
        width=camera.width,
        height=camera.height,
        has_planes=_has_planes(schedule, courses),
        engine=ENGINES.index(robot.engine) if robot.engine in ENGINES else OTHER,
        drive=Drive(robot.wheel_radius_m, robot.track_m, robot.axle_x_m, robot.height_m),
        body=rigid.body if rigid else RigidBody(*(0.0,) * len(RigidBody._fields)),
        substeps=rigid.substeps if rigid else 1,
        max_wheel_velocity_rad_s=robot.max_wheel_velocity_rad_s,
        speed=parameters.speed,
        limits=Limits(
            rules.max_distance_m,
            rules.max_laps,
            rules.max_steps,
            rules.no_progress_steps,
            rules.min_progress_m,
        ),
        dark_intensity=parameters.pixels.coppelia.dark_intensity,
        esim=(
            esim_constants(parameters.pixels.esim, camera.width, camera.height)
            if parameters.pixels.model == 'esim'
            else None
        ),
        n_images=n_images,
        filters=make_chain(filters, camera.width, camera.height),
        has_wheel_errors=schedule.has_wheel_errors,
        has_dead=any(schedule.values_of('pixels.dead_share')),
        has_losses=schedule.largest('link.event_loss') > 0,
        most_latency_steps=round(schedule.largest('link.latency_ms')) // parameters.period_ms,
        most_noise_hz=schedule.largest('pixels.coppelia.noise_rate_hz'),
        most_esim_noise_hz=schedule.largest('pixels.esim.shot_rate_hz')
        + schedule.largest('pixels.esim.leak_rate_hz'),
        period_ns=parameters.period_ns,
        period_s=parameters.period_s,
    )


def _has_planes(schedule: Schedule, courses: Sequence[Course]) -> bool:
    """Return whether images of three intensities are all that pixels need to remember."""
    camera, pixels = schedule.parameters.camera, schedule.parameters.pixels
    if camera.antialias or pixels.model == 'esim' or schedule.changing & _INTENSITIES:
        return False
    grounds = [seen_ground(each, camera) for each in courses]
    return all(
        fires_always(
            camera.background_intensity,
            each.floor_intensity,
            each.marking_intensity,
            pixels.coppelia.threshold,
            pixels.coppelia.dark_intensity,
        )
        for each in grounds
    )


def _bounds(sizes: Sequence[int]) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
