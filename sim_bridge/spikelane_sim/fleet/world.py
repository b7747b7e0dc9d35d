"""What all robots of a fleet share, as numbers: courses, camera, robot, pixels, rules."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.bit_planes import fires_always
from spikelane_sim.camera import ANTIALIAS_ROWS, Camera
from spikelane_sim.course import Course
from spikelane_sim.errors import ParameterError
from spikelane_sim.filters import FilterParameters
from spikelane_sim.filters.compiled import Chain, check_chain, make_chain
from spikelane_sim.pixels.crossings import Constants
from spikelane_sim.pixels.esim import esim_constants
from spikelane_sim.robots import KINEMATIC, RIGID
from spikelane_sim.robots.rigid import RigidBody, RigidDrive
from spikelane_sim.simulator_parameters import SimulatorParameters

#: Engines that a fleet has, by the numbers that the kernel knows.
ENGINES = (KINEMATIC, RIGID)


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
        intensities: Intensities of background, floor and marking on each course, as an image has
            them, (n_courses, 3).
        ground: Intensities of floor and marking, as `render` is given them, (n_courses, 2).
        lens: The camera, with the columns of `raster`, (12,).
        n_rows: Scanlines per row of pixels.
        width: Columns of the image [px].
        height: Rows of the image [px].
        has_planes: Whether images are bit planes.
        engine: Index in `ENGINES`.
        drive: For the engine kinematic.
        body: For the engine rigid.
        substeps: Steps of the physics in a step of 50 ms.
        max_wheel_velocity_rad_s: The robot's limit.
        limits: When an episode ends.
        threshold: Parameter of the pixels, as are the next two.
        dark_intensity: See `CoppeliaParameters`.
        noise_rate_hz: See `CoppeliaParameters`.
        has_esim: Whether the pixels are those of `esim`.
        esim: What these have in common.
        n_images: Images that are rendered for a step.
        filters: Filters of the events.
        event_loss: Share of events that are lost.
        latency_steps: From an observation to its command, beyond the usual.
    """

    pieces: NDArray[np.float64]
    first_piece: NDArray[np.int64]
    curves: NDArray[np.float64]
    first_segment: NDArray[np.int64]
    first_lane: NDArray[np.int64]
    lengths_m: NDArray[np.float64]
    starts: NDArray[np.float64]
    intensities: NDArray[np.float64]
    ground: NDArray[np.float64]
    lens: NDArray[np.float64]
    n_rows: int
    width: int
    height: int
    has_planes: bool
    engine: int
    drive: Drive
    body: RigidBody
    substeps: int
    max_wheel_velocity_rad_s: float
    limits: Limits
    threshold: float
    dark_intensity: float
    noise_rate_hz: float
    has_esim: bool
    esim: Constants
    n_images: int
    filters: Chain
    event_loss: float
    latency_steps: int


def make_world(
    parameters: SimulatorParameters, courses: Sequence[Course], filters: FilterParameters
) -> World:
    """Return what the robots of a fleet share.

    Args:
        parameters: Parameters of the simulation; its course has no effect.
        courses: On which the robots drive, at least one.
        filters: Filters of the events.

    Raises:
        SpikelaneError: A fleet cannot simulate this, or a filter cannot be made; the message
            names the parameter.
    """
    check_world(parameters, filters)
    n_images = parameters.pixels.images_per_step
    has_esim = parameters.pixels.model == 'esim'
    lanes = [lane for course in courses for lane in course.lanes.values()]
    camera, robot = parameters.camera, parameters.robot
    pixels, rules = parameters.pixels.coppelia, parameters.episode
    rigid = RigidDrive(robot, n_images) if robot.engine == RIGID else None
    intensities = [
        (camera.background_intensity, each.ground.floor_intensity, each.ground.marking_intensity)
        for each in courses
    ]
    return World(
        pieces=np.concatenate([each.ground.pieces for each in courses]),
        first_piece=_bounds([len(each.ground.pieces) for each in courses]),
        curves=np.concatenate([lane.centre for lane in lanes]),
        first_segment=_bounds([len(lane.centre) for lane in lanes]),
        first_lane=_bounds([len(each.lanes) for each in courses]),
        lengths_m=np.array([lane.length_m for lane in lanes]),
        starts=np.array([lane.start for lane in lanes]),
        intensities=np.array(intensities, np.float32).astype(np.float64),
        ground=np.array([each[1:] for each in intensities]),
        lens=Camera(camera, courses[0]).lens,
        n_rows=ANTIALIAS_ROWS if camera.antialias else 1,
        width=camera.width,
        height=camera.height,
        has_planes=not (camera.antialias or has_esim)
        and all(
            fires_always(*each, pixels.threshold, pixels.dark_intensity) for each in intensities
        ),
        engine=ENGINES.index(robot.engine),
        drive=Drive(robot.wheel_radius_m, robot.track_m, robot.axle_x_m, robot.height_m),
        body=rigid.body if rigid else RigidBody(*(0.0,) * len(RigidBody._fields)),
        substeps=rigid.substeps if rigid else 1,
        max_wheel_velocity_rad_s=robot.max_wheel_velocity_rad_s,
        limits=Limits(
            rules.max_distance_m,
            rules.max_laps,
            rules.max_steps,
            rules.no_progress_steps,
            rules.min_progress_m,
        ),
        threshold=pixels.threshold,
        dark_intensity=pixels.dark_intensity,
        noise_rate_hz=pixels.noise_rate_hz,
        has_esim=has_esim,
        esim=esim_constants(parameters.pixels.esim, camera.width, camera.height),
        n_images=n_images,
        filters=make_chain(filters, camera.width, camera.height),
        event_loss=parameters.link.event_loss,
        latency_steps=parameters.link.latency_steps,
    )


def check_world(parameters: SimulatorParameters, filters: FilterParameters) -> None:
    """Check that the kernel has what parameters ask for.

    Raises:
        ParameterError: It has not; the message names the parameter.
    """
    engine = parameters.robot.engine
    if engine not in ENGINES:
        raise ParameterError(
            f'robot.engine: expected {" or ".join(ENGINES)} in a fleet, got {engine}'
        )
    check_chain(filters)


def _bounds(sizes: Sequence[int]) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
