"""The balance controller with a loop of its own around the wheels, closed by their encoders."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

from my_controllers.balance import Balance, BalanceParameters
from spikelane_sim.contract import Observation, WheelVelocities
from spikelane_sim.parameters import parameter


@dataclasses.dataclass(frozen=True, kw_only=True)
class MeteredParameters(BalanceParameters):
    """What can be set beyond that of the balance controller."""

    correction: float = parameter(
        0.5, 'Share of the lag of each wheel that is added to its command.', low=0.0, high=1.0
    )


class Metered(Balance):
    """Commands more than is wanted while the wheels lag behind; see `contract.Controller`."""

    parameters_class: ClassVar[type[MeteredParameters]] = MeteredParameters
    sensors: ClassVar[tuple[str, ...]] = ('events', 'encoders')

    parameters: MeteredParameters

    def step(self, observation: Observation) -> WheelVelocities:
        """Answer one observation."""
        wanted = super().step(observation)
        assert observation.encoders is not None  # as `sensors` asks for them
        left, right = observation.encoders.velocities
        share = self.parameters.correction
        return WheelVelocities(
            wanted.left + share * (wanted.left - left),
            wanted.right + share * (wanted.right - right),
        )
