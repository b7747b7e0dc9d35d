"""A controller that keeps the events on its left and on its right in balance."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import numpy as np

from spikelane_sim.contract import Observation, WheelVelocities
from spikelane_sim.encoding import count_events, EncodingParameters
from spikelane_sim.parameters import nested, parameter, Parameters


@dataclasses.dataclass(frozen=True, kw_only=True)
class BalanceParameters(Parameters):
    """What can be set: ROS parameters, YAML and --param are made from it."""

    speed_rad_s: float = parameter(
        1.0, 'Speed of both wheels when driving straight on.', unit='rad/s', low=0.0
    )
    gain_rad_s: float = parameter(
        0.5, 'Change of the wheel speeds when all events are on one side.', unit='rad/s', low=0.0
    )
    memory: float = parameter(
        0.8, 'Share of the counts that is kept in each step.', low=0.0, high=1.0
    )
    encoding: EncodingParameters = nested(EncodingParameters)


class Balance:
    """Controller that turns away from the side with more events; see `contract.Controller`."""

    parameters_class: ClassVar[type[BalanceParameters]] = BalanceParameters

    def __init__(self, parameters: BalanceParameters | None = None) -> None:
        self.parameters = parameters or BalanceParameters()
        # What is near, at the image's bottom, counts most.
        self._row_weights = np.arange(1.0, self.parameters.encoding.rows + 1.0) ** 2
        self.reset(np.random.default_rng(0))

    def reset(self, rng: np.random.Generator) -> None:
        """Begin an episode; all chance would have to come from rng."""
        del rng
        self._sides = np.zeros(2)

    def step(self, observation: Observation) -> WheelVelocities:
        """Answer one observation."""
        turn = self._turn(observation)
        speed = self.parameters.speed_rad_s
        return WheelVelocities(speed + turn, speed - turn)

    def _turn(self, observation: Observation) -> float:
        """Return by how much the left wheel is to be faster [rad/s]."""
        encoding = self.parameters.encoding
        counts = count_events(observation.events, encoding).reshape(encoding.rows, 2, -1)
        self._sides *= self.parameters.memory
        self._sides += self._row_weights @ counts.sum(axis=2)
        left, right = self._sides
        return float(self.parameters.gain_rad_s * (left - right) / max(left + right, 1.0))
