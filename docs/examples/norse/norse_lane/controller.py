"""The controller: it counts events, and lets the network answer."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from safetensors.torch import load_file
import torch

from norse_lane.network import LaneNetwork
from spikelane_sim.contract import Observation, WheelVelocities
from spikelane_sim.encoding import count_events, EncodingParameters
from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import parameter, Parameters

WEIGHTS = Path(__file__).with_name('weights.safetensors')


@dataclasses.dataclass(frozen=True, kw_only=True)
class NorseLaneParameters(Parameters):
    """What can be set: ROS parameters, YAML and --param are made from it."""

    speed_rad_s: float = parameter(1.3, 'Mean of the wheels.', unit='rad/s', low=0.0)
    weights: str = parameter('', "File that `norse_lane.train` has written; empty: the package's.")


class NorseLane:
    """Controller with a spiking network in Norse; see `contract.Controller`."""

    parameters_class: ClassVar[type[NorseLaneParameters]] = NorseLaneParameters

    def __init__(self, parameters: NorseLaneParameters | None = None) -> None:
        self.parameters = parameters or NorseLaneParameters()
        self._encoding = EncodingParameters()
        with torch.random.fork_rng():  # the weights are drawn at random before they are read
            self._network = LaneNetwork()
        self._network.load_state_dict(load_file(self._weights()))
        self.reset(np.random.default_rng(0))

    def reset(self, rng: np.random.Generator) -> None:
        """Begin an episode with neurons at rest; there is nothing random in the network."""
        del rng
        self._state: Any = None

    def _weights(self) -> Path:
        file = Path(self.parameters.weights) if self.parameters.weights else WEIGHTS
        if not file.is_file():
            raise ParameterError(
                f'weights: expected a file that norse_lane.train has written, got {file}'
            )
        return file

    @torch.no_grad()
    def step(self, observation: Observation) -> WheelVelocities:
        """Answer one observation."""
        counts = count_events(observation.events, self._encoding)
        inputs = torch.from_numpy(counts.reshape(1, -1).astype(np.float32))
        turns, self._state = self._network(inputs, self._state)
        speed, turn = self.parameters.speed_rad_s, turns.item()
        return WheelVelocities(speed + turn, speed - turn)
