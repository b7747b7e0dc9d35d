"""What hosts a controller, live or in a replay, has to know: when episodes begin, what it sees."""

from __future__ import annotations

import dataclasses
from typing import Any

from spikelane_controllers.change_check import changeable
from spikelane_sim.contract import Controller, controller_rng, Observation, WheelVelocities
from spikelane_sim.encoding import EncodingParameters
from spikelane_sim.episodes import EpisodeWatch
from spikelane_sim.errors import ParameterError
from spikelane_sim.parameter_changes import changeable_specs, ChangingParameters
from spikelane_sim.parameters import Parameters
from spikelane_sim.period import PERIOD_MS, SHORTEST_MS, TimedParameters


class ControllerHost:
    """Gives a controller observations, and resets it wherever they begin another episode.

    `EpisodeWatch` says where that is. Observations without a lane state belong to one episode that
    never ends, number 0 if there was none before.

    Attributes:
        changing: Takes changes of the controller's parameters, and tells which have taken effect;
            None where they are fixed.
    """

    def __init__(
        self,
        controller: Controller,
        seed: int,
        parameters: Parameters | None = None,
        period_ms: int | None = None,
    ) -> None:
        """Reset the controller to episode 0.

        Args:
            controller: Answers.
            seed: Seed of its randomness.
            parameters: What it was made from, where they may be changed.
            period_ms: Control period that it is made for; None where any will do.

        Raises:
            ParameterError: They may be changed, but the controller has no method for it.
        """
        if parameters is not None:
            for spec in changeable_specs(type(parameters)):
                changeable(controller, spec)
        self._controller: Any = controller
        self.changing = None if parameters is None else ChangingParameters(parameters)
        self._period_ms = period_ms
        self._last: Observation | None = None
        self._seed = seed
        self._episodes = EpisodeWatch()
        controller.reset(controller_rng(seed, 0))

    def step(self, observation: Observation) -> WheelVelocities:
        """Answer one observation.

        Raises:
            ParameterError: A step of the simulator does not last the controller's period.
        """
        lane = observation.lane
        if self._period_ms is not None:
            self._check_period(observation, self._period_ms)
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

    def _check_period(self, observation: Observation, period_ms: int) -> None:
        last, self._last = self._last, observation
        if last is None or last.lane is None or observation.lane is None:
            return
        now, before = observation.lane, last.lane
        if (now.episode, now.step) != (before.episode, before.step + 1):
            return
        lasted_ms = (observation.stamp_ns - last.stamp_ns) / 1e6
        # What is no period at all is a gap: observations were lost.
        if SHORTEST_MS <= lasted_ms <= PERIOD_MS and lasted_ms != period_ms:
            raise ParameterError(
                f'period_ms: expected {lasted_ms:g} ms, as the simulator steps, got {period_ms}'
            )


def period_ms_of(parameters: object) -> int | None:
    """Return the control period that parameters name; None where they name none."""
    return parameters.period_ms if isinstance(parameters, TimedParameters) else None


def period_ns_of(parameters: object) -> int:
    """Return the length of a controller's step [ns]: 50 ms where its parameters name none."""
    return (period_ms_of(parameters) or PERIOD_MS) * 1_000_000


def check_period(parameters: object, period_ms: int) -> None:
    """Check that a controller is made for a simulator's control period.

    Args:
        parameters: Those of the controller.
        period_ms: The simulator's period.

    Raises:
        ParameterError: It is made for another one.
    """
    if (own := period_ms_of(parameters)) not in (None, period_ms):
        raise ParameterError(
            f'period_ms: expected {period_ms} ms for the controller, as simulator.period_ms, '
            f'got {own}'
        )


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
