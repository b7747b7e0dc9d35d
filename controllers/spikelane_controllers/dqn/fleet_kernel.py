"""The deep Q-network of one robot of a fleet, compiled: what `Dqn.step` and `QLearning` do.

The arrays of what learns are those of the robot's own `QLearning`: megabytes that nothing copies.
Whatever else changes is in a record of `NUMBERS_DTYPE` and in small arrays.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.dqn.experience_buffer import put, Transitions
from spikelane_controllers.dqn.parameters import Exploration, exploration_rate
from spikelane_controllers.dqn.q_network import values_of
from spikelane_controllers.dqn.update_kernel import layers, Learnt, Rates, Shape, update
from spikelane_controllers.fleet_kernel import write_down
from spikelane_sim.compiled import inlined
from spikelane_sim.contract import TERMINATED_LANE_LOST
from spikelane_sim.encoding import count_cells
from spikelane_sim.episode_rules import REASONS
from spikelane_sim.fleet.generators import generator_at
from spikelane_sim.fleet.kernel import simulate
from spikelane_sim.kernel_arrays import borrowed
from spikelane_sim.task import lane_centre_reward

_LANE_LOST = REASONS.index(TERMINATED_LANE_LOST)
_MOST_COUNTED = 255  # as `visited_states` keeps them

#: Numbers that change; see `Dqn` and `QLearning`.
NUMBERS_DTYPE = np.dtype(
    [
        ('held', '<i8'),
        ('action', '<i8'),
        ('actions', '<i8'),
        ('reward', '<f8'),
        ('steps', '<i8'),
        ('updates', '<i8'),
        ('loss', '<f8'),
        ('oldest', '<i8'),  # of `Agent.frames`
        ('n_ended', '<i8'),  # rows of `Ended` that count
        ('has_ended', '<i8'),  # whether an action ended with the observation to be answered
        ('is_due', '<i8'),  # whether an update is to be made elsewhere before it is answered
        ('decisions', '<i8'),  # since the robot was loaded
        ('active', '<i8'),  # inputs that were 1, summed over these decisions
        ('last_active', '<i8'),  # in the last observation answered; -1: an action was held
    ]
)


class Setting(NamedTuple):
    """What the networks of a fleet have in common.

    Attributes:
        crop_top: Rows of pixels left out at the top.
        cell: Side of a cell [px].
        steps_per_action: Steps for which an action holds.
        reward_sigma_m: Standard deviation of the reward.
        wheels: Velocities of the wheels in each action [rad/s], (n_actions, 2).
        shape: Sizes of the layers.
        rates: Discount and learning rates that an update uses.
        exploration: How it falls.
        batch_size: Transitions in an update.
        update_every: Actions between two updates.
    """

    crop_top: int
    cell: int
    steps_per_action: int
    reward_sigma_m: float
    wheels: NDArray[np.float64]
    shape: Shape
    rates: Rates
    exploration: Exploration
    batch_size: int
    update_every: int


class Agent(NamedTuple):
    """What the network of one robot is and remembers.

    Attributes:
        is_learning: Whether it explores and learns.
        is_compiled: Whether updates are made here, and not by the one who calls.
        learnt: Its weights, and what else learning changes.
        transitions: Its experience.
        frames: Events in the cells in the last steps, (frames, rows, columns).
        counts: Events that the state was made of, (rows, columns).
        state: Binary, (n_inputs,).
    """

    is_learning: bool
    is_compiled: bool
    learnt: Learnt
    transitions: Transitions
    frames: NDArray[np.int64]
    counts: NDArray[np.int64]
    state: NDArray[np.uint8]


class Ended(NamedTuple):
    """Actions that have ended in a call; rows are actions.

    Attributes:
        rewards: What they brought, (n,).
        updates: Updates that there were in all, (n,).
        losses: Loss of the last update before the action ended, (n,).
        counts: Events that they led to, at most 255, (n, rows, columns).
    """

    rewards: NDArray[np.float64]
    updates: NDArray[np.int64]
    losses: NDArray[np.float64]
    counts: NDArray[np.uint8]


def make_ended(room: int, rows: int, columns: int) -> Ended:
    """Return room for so many actions."""
    return Ended(
        np.empty(room),
        np.empty(room, np.int64),
        np.empty(room),
        np.empty((room, rows, columns), np.uint8),
    )


@numba.njit(cache=True, nogil=True)
def advance(  # type: ignore[no-untyped-def]
    world, robots, scratch, template, setting, agent, numbers, seen, ended, chance, journey, i
):
    """Let robot i answer observations and drive, until it has done its part or an update is due.

    Args:
        world: The `World`.
        robots: The `Robots`.
        scratch: A `Scratch` of this thread.
        template: `generators.TEMPLATE`.
        setting: The `Setting`.
        agent: The `Agent` of the robot.
        numbers: Records of `NUMBERS_DTYPE`, (n_robots,).
        seen: Events in the observations to be answered, (n_robots, rows, columns).
        ended: The `Ended`, with room for all actions.
        chance: Addresses of the generators that actions and transitions are drawn from,
            (n_robots,).
        journey: The `Journey`.
        i: Which robot.
    """
    world, robots, scratch = borrowed(world), borrowed(robots), borrowed(scratch)
    setting, agent, journey = borrowed(setting), borrowed(agent), borrowed(journey)
    numbers, seen, ended = borrowed(numbers), borrowed(seen), borrowed(ended)
    own = numbers[i]
    rng = generator_at(template, chance[i])
    while journey.taken[i] < journey.wanted[i]:
        if not own.is_due:
            _observe(setting, agent, own, seen[i], rng, robots.known[i])
            if own.is_due:
                return
        own.is_due = 0
        _answer(setting, agent, own, ended, rng, robots.known[i])
        left, right = setting.wheels[own.action]
        if not write_down(robots, journey, i, left, right):
            break
        events = simulate(world, robots, scratch, template, i, left, right)
        count_cells(events, len(events), setting.crop_top, setting.cell, seen[i])


@numba.njit(cache=True)
def repeat(  # type: ignore[no-untyped-def]
    world, robots, scratch, template, setting, seen, i, answers
):
    """Drive robot i with answers (n, 2) that were given before."""
    world, robots, scratch = borrowed(world), borrowed(robots), borrowed(scratch)
    seen = borrowed(seen)
    for k in range(answers.shape[0]):
        events = simulate(world, robots, scratch, template, i, answers[k, 0], answers[k, 1])
        count_cells(events, len(events), setting.crop_top, setting.cell, seen[i])


@inlined
def _observe(setting, agent, own, seen, rng, known):  # type: ignore[no-untyped-def]
    """Take in an observation; see `Dqn.step`."""
    own.held += 1
    own.has_ended = 0
    if own.held > 0:
        agent.frames[own.oldest] = seen
        own.oldest = (own.oldest + 1) % len(agent.frames)
        if own.held == setting.steps_per_action or known.reason > 0:
            _end_action(setting, agent, own, rng, known)


@inlined
def _answer(setting, agent, own, ended, rng, known):  # type: ignore[no-untyped-def]
    """Choose what to do after an observation; see `Dqn.step`."""
    own.last_active = -1
    if own.has_ended and agent.is_learning:
        _write_down_action(own, agent.counts.ravel(), ended)
    if own.held == 0 and not known.reason > 0:
        own.last_active = np.count_nonzero(agent.state)
        own.decisions += 1
        own.active += own.last_active
        own.action = _choose(setting, agent, own, rng)


@inlined
def _choose(setting, agent, own, rng):  # type: ignore[no-untyped-def]
    """Return an action; see `QLearning.act`."""
    if agent.is_learning and rng.random() < exploration_rate(setting.exploration, own.steps):
        return rng.integers(0, setting.shape.n_actions)
    network = layers(agent.learnt.weights, setting.shape)
    return np.int64(np.argmax(values_of(network, agent.state.reshape(1, -1))[0]))


@inlined
def _end_action(setting, agent, own, rng, known):  # type: ignore[no-untyped-def]
    """Observe what the action led to, and learn from it."""
    before = agent.state.copy()
    own.held, own.has_ended = 0, 1
    own.actions += 1
    counts = agent.counts
    counts[:] = 0
    for frame in range(len(agent.frames)):
        counts += agent.frames[frame]
    seen = counts.ravel()
    for k in range(len(seen)):
        agent.state[k] = seen[k] > 0
    own.reward = lane_centre_reward(known.distance_m, setting.reward_sigma_m)
    if agent.is_learning:
        _learn(setting, agent, own, before, rng, known.reason == _LANE_LOST)


@inlined
def _learn(setting, agent, own, before, rng, is_final):  # type: ignore[no-untyped-def]
    """Take in a transition, and update when it is time; see `QLearning.learn`."""
    put(agent.transitions, own.steps, before, own.action, own.reward, agent.state, is_final)
    own.steps += 1
    is_time = own.steps % setting.update_every == 0
    if not (is_time and own.steps > setting.exploration.random_steps):
        return
    own.is_due = not agent.is_compiled
    if agent.is_compiled:
        kept = min(own.steps, len(agent.transitions.actions))
        drawn = rng.integers(0, kept, setting.batch_size)
        own.loss = update(
            agent.learnt, setting.shape, setting.rates, agent.transitions, drawn, own.updates
        )
        own.updates += 1


@inlined
def _write_down_action(own, seen, ended):  # type: ignore[no-untyped-def]
    n = own.n_ended
    ended.rewards[n], ended.updates[n], ended.losses[n] = own.reward, own.updates, own.loss
    counts = ended.counts[n].ravel()
    for k in range(len(seen)):
        counts[k] = min(seen[k], _MOST_COUNTED)
    own.n_ended += 1
