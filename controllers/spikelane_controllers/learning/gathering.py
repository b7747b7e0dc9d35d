"""Gathering states where the robot will be: a trained policy drives on (paper section 5.2).

Most states of a training are far from the lane's centre, met before the policy was any good; the
robot will hardly see such again. So the trained policy goes on driving, and now and then does
something at random, to know what to do when a little off.
"""

from __future__ import annotations

from collections.abc import Callable
import dataclasses

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.encoding import Counts, StateImage, StateImageParameters
from spikelane_sim.parameters import check_size, nested, parameter, Parameters
from spikelane_sim.simulator import Simulator
from spikelane_sim.task import action_wheels, ACTIONS, DecisionParameters

#: Chooses an action, an index of ACTIONS, by the counts of events, (rows, columns).
Policy = Callable[[Counts], int]

#: What is told while it drives: states gathered, and of how many.
OnProgress = Callable[[int, int], None]

_MOST = 255  # that a count can be in a stored state


#: States that one transfer learns from.
MOST_STATES = 10_000_000


@dataclasses.dataclass(frozen=True, kw_only=True)
class GatheringParameters(Parameters):
    """How many states, and how they are met."""

    states: int = parameter(50_000, 'Number of states to gather.', low=1, high=MOST_STATES)
    random_actions: float = parameter(
        0.1, 'Share of the actions that is drawn at random.', low=0.0, high=1.0
    )
    decision: DecisionParameters = nested(DecisionParameters)
    encoding: StateImageParameters = nested(StateImageParameters)

    def _check_relations(self) -> None:
        inputs = self.encoding.rows * self.encoding.columns
        check_size('counts', {'states': self.states, 'inputs (encoding)': inputs}, 5e8)


def gather_states(
    simulator: Simulator,
    policy: Policy,
    parameters: GatheringParameters,
    seed: int,
    show: OnProgress = lambda states, of: None,
) -> NDArray[np.uint8]:
    """Drive with a policy and keep the state before each action.

    Lanes alternate, whenever the lane is lost or the simulator's limit is reached.

    Args:
        simulator: Where to drive.
        policy: What drives.
        parameters: How many states, and how they are met.
        seed: Seed of the simulator, and of the random actions.
        show: Called after every action.

    Returns:
        Events in each cell over the last frames, at most 255, (states, rows * columns).
    """
    # Seeds are padded with zeros: so begins the simulator's generator in episode 2, too, whose
    # noise, if there is any, comes of the same numbers. Another one would gather other states.
    rng = np.random.default_rng([seed, 2])
    image = StateImage(parameters.encoding)
    cells = parameters.encoding.rows * parameters.encoding.columns
    states = np.empty((parameters.states, cells), np.uint8)
    simulator.reset(None, seed)
    for number in range(parameters.states):
        counts = image.counts
        states[number] = np.minimum(counts, _MOST).ravel()
        is_random = rng.random() < parameters.random_actions
        action = int(rng.integers(len(ACTIONS))) if is_random else policy(counts)
        _hold(simulator, action, image, parameters.decision)
        show(number + 1, parameters.states)
    return states


def _hold(
    simulator: Simulator, action: int, image: StateImage, parameters: DecisionParameters
) -> None:
    """Do an action for its time; begin another episode where it ends this one."""
    wheels = action_wheels(action, parameters)
    for _ in range(parameters.steps_per_action):
        observation = simulator.step(wheels)
        image.add(observation.events)
        if observation.lane is not None and observation.lane.terminated:
            simulator.reset()
            image.clear()
            return
