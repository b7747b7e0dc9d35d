"""What changes from robot to robot and episode to episode, as numbers for the kernel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_sim import raster
from spikelane_sim.camera import make_lens, seen_ground
from spikelane_sim.compiled import inner
from spikelane_sim.course import Course
from spikelane_sim.pixels.crossings import Constants
from spikelane_sim.pixels.dead import dead_pixels
from spikelane_sim.simulator_parameters import SimulatorParameters

#: The phases of an episode, see `Phases`.
N_PHASES = 2

#: One phase of a robot's episode.
CONDITION_DTYPE = np.dtype(
    [
        ('markings', '<i8'),  # the course whose markings are seen
        ('floor', '<f8'),  # intensities, as `render` is given them
        ('marking', '<f8'),
        ('threshold', '<f8'),
        ('noise_rate_hz', '<f8'),
        ('leak_rate_hz', '<f8'),
        ('shot_rate_hz', '<f8'),
        ('event_loss', '<f8'),
        ('latency_steps', '<i8'),
        ('left', '<f8'),  # errors of the wheels
        ('right', '<f8'),
        ('track', '<f8'),
    ]
)


class Conditions(NamedTuple):
    """The phases of the robots' episodes; rows are robots.

    Attributes:
        step: The step at whose beginning the second phase holds, (n_robots,).
        numbers: Records of `CONDITION_DTYPE`, (n_robots, 2).
        lens: The camera, with the columns of `raster`, (n_robots, 2, 14).
        seen: Intensities of background, floor and marking, as an image has them,
            (n_robots, 2, 3).
        dead: Which pixels are dead, (n_robots, 2, height * width); of no size where none ever is.
    """

    step: NDArray[np.int64]
    numbers: NDArray[np.void]
    lens: NDArray[np.float64]
    seen: NDArray[np.float64]
    dead: NDArray[np.bool_]


def make_conditions(n_robots: int, dead_pixels: int) -> Conditions:
    """Return room for the phases of robots; dead_pixels is how many pixels can be dead."""
    rows = n_robots, N_PHASES
    return Conditions(
        np.zeros(n_robots, np.int64),
        np.zeros(rows, CONDITION_DTYPE),
        np.zeros((*rows, raster.N_LENS)),
        np.zeros((*rows, 3)),
        np.zeros((*rows, dead_pixels), np.bool_),
    )


def write_condition(
    conditions: Conditions,
    robot: int,
    phase: int,
    parameters: SimulatorParameters,
    markings: tuple[int, Course],
) -> None:
    """Write down one phase of a robot's episode.

    Args:
        conditions: Where it goes.
        robot: Which robot.
        phase: 0 or 1.
        parameters: What holds in the phase.
        markings: Number and course whose markings are seen.
    """
    camera, pixels, robot_of = parameters.camera, parameters.pixels, parameters.robot
    number, course = markings
    ground = seen_ground(course, camera)
    row = conditions.numbers[robot, phase]
    row['markings'] = number
    row['floor'], row['marking'] = ground.floor_intensity, ground.marking_intensity
    row['threshold'] = pixels.coppelia.threshold
    row['noise_rate_hz'] = pixels.coppelia.noise_rate_hz
    row['leak_rate_hz'], row['shot_rate_hz'] = pixels.esim.leak_rate_hz, pixels.esim.shot_rate_hz
    row['event_loss'] = parameters.link.event_loss
    row['latency_steps'] = parameters.link.latency_steps(parameters.period_ms)
    row['left'], row['right'], row['track'] = robot_of.wheel_errors
    conditions.lens[robot, phase] = make_lens(camera)
    seen = (camera.background_intensity, ground.floor_intensity, ground.marking_intensity)
    conditions.seen[robot, phase] = np.array(seen, np.float32)
    if conditions.dead.shape[2]:
        conditions.dead[robot, phase] = dead_pixels(
            pixels.dead_share, pixels.dead_seed, camera.width, camera.height
        )


@inner
def with_rates(esim, condition):  # type: ignore[no-untyped-def]
    """Return what all pixels of `esim` have in common, with the noise of a condition.

    Args:
        esim: The `Constants`.
        condition: A record of `CONDITION_DTYPE`.
    """
    return Constants(
        esim.dark_intensity,
        condition.leak_rate_hz,
        condition.shot_rate_hz,
        esim.shot_bright_factor,
        esim.hot_rate_hz,
        esim.hot,
        esim.latency_us,
        esim.refractory_us,
        esim.width,
    )
