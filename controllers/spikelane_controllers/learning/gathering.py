"""Gathering states where the robot will be: a trained controller drives on (paper section 5.2).

Most states of a training are far from the lane's centre, met before the policy was any good; the
robot will hardly see such again. So the trained controller goes on driving, and now and then
something is done at random, to know what to do when a little off.
"""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.controller_host import ControllerHost
from spikelane_sim.contract import Controller, Observation
from spikelane_sim.encoding import StateImage, StateImageParameters
from spikelane_sim.filters import FilterParameters, FilterStage
from spikelane_sim.parameters import check_size, nested, parameter, Parameters
from spikelane_sim.simulator import Simulator
from spikelane_sim.task import action_wheels, ACTIONS, DecisionParameters

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


class Gathered(NamedTuple):
    """States, and the episodes that they were met in."""

    counts: NDArray[np.uint8]  # events in each cell, at most 255, (states, rows * columns)
    episodes: NDArray[np.int64]  # numbers of the episodes, (states,)


def gather_states(
    simulator: Simulator,
    controller: Controller,
    parameters: GatheringParameters,
    seed: int,
    show: OnProgress = lambda states, of: None,
    filters: FilterParameters | None = None,
) -> Gathered:
    """Let a controller drive and keep the state before each action.

    Lanes alternate, whenever the lane is lost or the simulator's limit is reached.

    Args:
        simulator: Where to drive.
        controller: What drives; it also sees what comes of random actions.
        parameters: How many states, and how they are met.
        seed: Seed of the simulator, of the controller and of the random actions.
        show: Called after every action.
        filters: What events go through before they reach the controller and the states; None for
            no filter.

    Raises:
        SpikelaneError: A filter cannot be made.
    """
    # Seeds are padded with zeros: so begins the simulator's generator in episode 2, too, whose
    # noise, if there is any, comes of the same numbers. Another one would gather other states.
    rng = np.random.default_rng([seed, 2])
    period = simulator.parameters
    host = ControllerHost(controller, seed)
    encoding = parameters.encoding
    image = StateImage(encoding, period.steps_of(encoding.frames, encoding.frame_ms))
    cells = encoding.rows * encoding.columns
    counts = np.empty((parameters.states, cells), np.uint8)
    episodes = np.empty(parameters.states, np.int64)
    stage = FilterStage(filters or FilterParameters(), period.camera.width, period.camera.height)
    observation = stage.observe(simulator.reset(None, seed))
    for number in range(parameters.states):
        counts[number] = np.minimum(image.counts, _MOST).ravel()
        assert observation.lane is not None  # a simulator knows it
        episodes[number] = observation.lane.episode
        is_random = rng.random() < parameters.random_actions
        drawn = int(rng.integers(len(ACTIONS))) if is_random else None
        observation = _act(simulator, stage, host, observation, drawn, image, parameters.decision)
        show(number + 1, parameters.states)
    return Gathered(counts, episodes)


def _act(
    simulator: Simulator,
    stage: FilterStage,
    host: ControllerHost,
    observation: Observation,
    drawn: int | None,
    image: StateImage,
    parameters: DecisionParameters,
) -> Observation:
    """Drive for the time of an action, the one drawn if there is one, else as the controller does.

    Returns:
        What is observed then; the first observation of the next episode where this one has ended.
    """
    for _ in range(simulator.parameters.steps_of(parameters.steps_per_action, parameters.step_ms)):
        wheels = host.step(observation)
        if drawn is not None:
            wheels = action_wheels(drawn, parameters)
        observation = stage.observe(simulator.step(wheels))
        image.add(observation.events)
        if observation.lane is not None and observation.lane.terminated:
            image.clear()
            return stage.observe(simulator.reset())
    return observation
