"""What hosts a controller, live or in a replay, has to know: when episodes begin, what it sees."""

from __future__ import annotations

import dataclasses
from typing import Any

from spikelane_controllers.change_check import changeable
from spikelane_sim.contract import Controller, controller_rng, Observation, WheelVelocities
from spikelane_sim.encoding import EncodingParameters
from spikelane_sim.episodes import EpisodeWatch
from spikelane_sim.parameter_changes import changeable_specs, ChangingParameters
from spikelane_sim.parameters import Parameters


class ControllerHost:
    """Gives a controller observations, and resets it wherever they begin another episode.

    `EpisodeWatch` says where that is. Observations without a lane state belong to one episode that
    never ends, number 0 if there was none before.

    Attributes:
        changing: Takes changes of the controller's parameters, and tells which have taken effect;
            None where they are fixed.
    """

    def __init__(
        self, controller: Controller, seed: int, parameters: Parameters | None = None
    ) -> None:
        """Reset the controller to episode 0.

        Args:
            controller: Answers.
            seed: Seed of its randomness.
            parameters: What it was made from, where they may be changed.

        Raises:
            ParameterError: They may be changed, but the controller has no method for it.
        """
        if parameters is not None:
            for spec in changeable_specs(type(parameters)):
                changeable(controller, spec)
        self._controller: Any = controller
        self.changing = None if parameters is None else ChangingParameters(parameters)
        self._seed = seed
        self._episodes = EpisodeWatch()
        controller.reset(controller_rng(seed, 0))

    def step(self, observation: Observation) -> WheelVelocities:
        """Answer one observation."""
        lane = observation.lane
        begins_episode = lane is not None and self._episodes.begins(lane)
        changing = self.changing
        if changing is not None and changing.take_effect(
            observation.stamp_ns, begins_episode=begins_episode
        ):
            self._controller.change(changing.parameters)
        if lane is not None and begins_episode:
            self._controller.reset(controller_rng(self._seed, lane.episode))
        wheels: WheelVelocities = self._controller.step(observation)
        return wheels


def image_size(parameters: Parameters) -> tuple[int, int]:
    """Return width and height [px] of the image that a controller's parameters are made for.

    That is the size of its encoding; 128 x 128 (DVS128) where it has none. A camera's image is
    scaled to it, a simulator's has to have it.
    """
    default = EncodingParameters()
    for field in dataclasses.fields(parameters):  # type: ignore[arg-type]
        value = getattr(parameters, field.name)
        if isinstance(value, EncodingParameters):
            return value.width, value.height
    return default.width, default.height
