"""What the spiking controllers of a fleet have in common: cells, Poisson inputs, steering."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.fleet_kernel import write_down
from spikelane_controllers.spiking.neuron import LANES
from spikelane_controllers.spiking.poisson import PoissonScale, Shares, spikes_of_counts
from spikelane_controllers.spiking.spikes import grid_steps, take_up
from spikelane_controllers.spiking.steering import steer, SteeringConstants, SteeringState
from spikelane_sim.compiled import inner, uncounted
from spikelane_sim.encoding import count_cells, EncodingParameters
from spikelane_sim.fleet.generators import generator_at, Generators
from spikelane_sim.fleet.kernel import simulate
from spikelane_sim.kernel_arrays import borrowed

#: Robots whose networks, of two neurons each, run at the same time.
TOGETHER = LANES // 2


class Cells(NamedTuple):
    """How the image is divided; see `EncodingParameters`."""

    crop_top: int
    cell: int


class Motors(NamedTuple):
    """What is between the camera and the network, and between the network and the wheels.

    Attributes:
        cells: How the image is divided.
        scale: From counts to rates.
        steering: From spikes to wheels.
        counts: Events in each cell in the observation to be answered, (n_robots, rows, columns).
        shares: Fields of `Shares`, (n_robots, rows * columns + 1).
        smoothed: Fields of `SteeringState`, (n_robots, 2).
        spikes: Spikes of the left and the right neuron in the last step, (n_robots, 2).
        decisions: Observations answered since the row was loaded, (n_robots,).
        inputs: Spikes of the inputs in the last step, and since the row was loaded, (n_robots, 2).
        distance_m: Distance in the observation answered last, (n_robots,).
        chance: Addresses of the generators that inputs are drawn from, (n_robots,).
        window: Length of a step [grid steps].
        share: Length of a step in steps of 50 ms.
    """

    cells: Cells
    scale: PoissonScale
    steering: SteeringConstants
    counts: NDArray[np.int64]
    shares: Shares
    smoothed: NDArray[np.float64]
    spikes: NDArray[np.int64]
    decisions: NDArray[np.int64]
    inputs: NDArray[np.int64]
    distance_m: NDArray[np.float64]
    chance: NDArray[np.uintp]
    window: int
    share: float


def make_motors(n_robots: int, parameters: Any, generators: Generators) -> Motors:
    """Return what robots need whose parameters have encoding, poisson, steering and period_ms."""
    encoding: EncodingParameters = parameters.encoding
    poisson, steering = parameters.poisson, parameters.steering
    inputs = encoding.rows * encoding.columns
    return Motors(
        Cells(encoding.crop_top, encoding.cell),
        PoissonScale(poisson.max_rate_hz, poisson.max_events),
        SteeringConstants(steering.n_max, steering.v_min, steering.v_max, steering.turn),
        np.zeros((n_robots, encoding.rows, encoding.columns), np.int64),
        Shares(np.zeros((n_robots, inputs + 1)), np.zeros((n_robots, inputs + 1), np.int64)),
        np.zeros((n_robots, 2)),
        np.zeros((n_robots, 2), np.int64),
        np.zeros(n_robots, np.int64),
        np.zeros((n_robots, 2), np.int64),
        np.zeros(n_robots),
        generators.addresses,
        grid_steps('period_ms', parameters.period_ms),
        parameters.share,
    )


def most_inputs(parameters: Any) -> int:
    """Return a number of inputs' spikes that no step has: 20 standard deviations above the mean.

    Args:
        parameters: Those of a controller with encoding and poisson.
    """
    encoding, poisson = parameters.encoding, parameters.poisson
    mean = poisson.max_rate_hz * parameters.period_s * encoding.rows * encoding.columns
    return int(mean + 20 * math.sqrt(mean + 1)) + 64


@uncounted
def gather(journey, members, number, following, last):  # type: ignore[no-untyped-def]
    """Fill up the robots that drive together.

    Args:
        journey: The `Journey`; robots that are reached begin it.
        members: Which robots drive, (TOGETHER,).
        number: How many of them count.
        following: The next robot.
        last: The robot to stop before.

    Returns:
        How many robots drive, and the next one.
    """
    while number < len(members) and following < last:
        journey.taken[following], journey.has_ended[following] = 0, False
        if journey.wanted[following] > 0:
            members[number] = following
            number += 1
        following += 1
    return number, following


@inner
def drive_together(  # type: ignore[no-untyped-def]
    world, robots, scratch, template, motors, journey, members, number, fired, n_fired
):
    """Let robots drive on by what their neurons have fired.

    Args:
        world: The `World`; this and the next three as in `simulate`.
        robots: The `Robots`.
        scratch: The `Scratch`.
        template: `generators.TEMPLATE`.
        motors: The `Motors`.
        journey: The `Journey`.
        members: Which robots drive; those that go on are moved to the front.
        number: How many of them count.
        fired: Spikes of the neurons in the last step, (n_robots, room).
        n_fired: How many of them count, (n_robots,).

    Returns:
        How many go on.
    """
    going = 0
    for m in range(number):
        i = members[m]
        left, right = turn_wheels(motors, i, fired[i, : n_fired[i]])
        goes_on = drive_on(world, robots, scratch, template, motors, journey, i, left, right)
        if goes_on and journey.taken[i] < journey.wanted[i]:
            members[going] = i
            going += 1
    return going


@inner
def let_fly(  # type: ignore[no-untyped-def]
    motors, template, i, flying, n_flying, has_overflown
):
    """Draw the spikes of robot i's inputs and let them fly; return False where there is no room.

    Args:
        motors: The `Motors`.
        template: `generators.TEMPLATE`.
        i: Which robot.
        flying: Spikes on their way, (n_robots, room).
        n_flying: How many of them count, (n_robots,).
        has_overflown: Whether spikes had no room, (n_robots,).
    """
    inputs = draw_inputs(motors, template, i)
    if n_flying[i] + len(inputs) > flying.shape[1]:
        has_overflown[i] = True
        return False
    n_flying[i] = take_up(flying[i], n_flying[i], inputs)
    return True


@inner
def draw_inputs(motors, template, i):  # type: ignore[no-untyped-def]
    """Return the spikes of robot i's inputs in a step."""
    rng = generator_at(template, motors.chance[i])
    shares = Shares(motors.shares.bounds_hz[i], motors.shares.sources[i])
    spikes = spikes_of_counts(
        motors.counts[i], motors.scale, motors.share, motors.window, rng, shares
    )
    motors.decisions[i] += 1
    motors.inputs[i, 0] = len(spikes)
    motors.inputs[i, 1] += len(spikes)
    return spikes


@uncounted
def turn_wheels(motors, i, fired):  # type: ignore[no-untyped-def]
    """Return the wheels' velocities [rad/s] that follow from robot i's spikes, (left, right)."""
    left, right = 0, 0
    for spike in fired:
        if spike.source == 0:
            left += 1
        else:
            right += 1
    motors.spikes[i, 0], motors.spikes[i, 1] = left, right
    smoothed = motors.smoothed[i]
    before = SteeringState(smoothed[0], smoothed[1])
    state, wheels = steer(before, left, right, motors.steering, motors.share)
    smoothed[0], smoothed[1] = state.speed, state.turn
    return wheels.left, wheels.right


@inner
def look_at(motors, events, i):  # type: ignore[no-untyped-def]
    """Let robot i's controller see the events of a step."""
    count_cells(events, len(events), motors.cells.crop_top, motors.cells.cell, motors.counts[i])


@inner
def drive_on(  # type: ignore[no-untyped-def]
    world, robots, scratch, template, motors, journey, i, left, right
):
    """Write down an answer of robot i and drive for a step; return whether the episode goes on.

    Nothing is driven where the observation that was answered ended the episode.
    """
    motors.distance_m[i] = robots.known[i].distance_m
    if not write_down(robots, journey, i, left, right):
        return False
    look_at(motors, simulate(world, robots, scratch, template, i, left, right), i)
    return True


@numba.njit(cache=True)
def repeat(  # type: ignore[no-untyped-def]
    world, robots, scratch, template, motors, i, answers
):
    """Drive robot i with answers (n, 2) that were given before."""
    world, robots, scratch = borrowed(world), borrowed(robots), borrowed(scratch)
    motors = borrowed(motors)
    for k in range(answers.shape[0]):
        events = simulate(world, robots, scratch, template, i, answers[k, 0], answers[k, 1])
        look_at(motors, events, i)
