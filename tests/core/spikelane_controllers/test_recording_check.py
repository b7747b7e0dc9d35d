"""The check of what a controller of one's own records, as `spikelane check` makes it."""

# ruff: noqa: D102  # what the methods are for stands in the contract

from __future__ import annotations

from collections.abc import Callable, Collection
import dataclasses
from typing import Any, ClassVar

import numpy as np
import pytest

import spikelane
from spikelane_controllers.controller_check import check_controller
from spikelane_controllers.quantities import Axis, Quantity, SpikeTimes
from spikelane_controllers.shown import Shown
from spikelane_sim.contract import Observation, WheelVelocities
from spikelane_sim.parameters import Parameters

NEURONS = Axis('neuron', ('one', 'two'))
VOLTAGES = Quantity('voltages', 'voltages of the neurons', 'V', (NEURONS,))
SPIKES = Quantity('spikes', 'spikes of the neurons', 'ns', (NEURONS,), is_spikes=True)


@dataclasses.dataclass(frozen=True, kw_only=True)
class NoParameters(Parameters):
    """A controller without parameters."""


class Recording:
    """Keeps the contract."""

    parameters_class: ClassVar[Any] = NoParameters
    quantities: ClassVar[Any] = (VOLTAGES, SPIKES)
    names: Collection[str] = ()

    def __init__(self, parameters: Any) -> None:
        self.recorded: dict[str, Any] = {}

    def reset(self, rng: np.random.Generator) -> None:
        self.recorded = {}

    def record(self, names: Collection[str]) -> None:
        self.names = names

    def step(self, observation: Observation) -> WheelVelocities:
        samples = {'voltages': self.voltages(), 'spikes': self.spikes()}
        self.recorded = {name: samples[name] for name in self.names}
        return WheelVelocities(1.0, 1.0)

    def voltages(self) -> Any:
        return np.array([[0.1, 0.2]])

    def spikes(self) -> Any:
        return SpikeTimes(np.array([0, 50_000_000]), np.array([1, 0]))

    @property
    def shown(self) -> Shown:
        return Shown(quantities=self.quantities, recorded=self.recorded)


class WithoutMethod(Recording):
    """Has no method record."""

    record: Any = None


class Flat(Recording):
    """Has no axis of samples."""

    def voltages(self) -> Any:
        return np.array([0.1, 0.2])


class Nameless(Recording):
    """Records spikes of a neuron that is not there."""

    def spikes(self) -> Any:
        return SpikeTimes(np.array([5]), np.array([2]))


class Late(Recording):
    """Records a spike after the step's end."""

    def spikes(self) -> Any:
        return SpikeTimes(np.array([50_000_001]), np.array([0]))


class Silent(Recording):
    """Forgets one quantity."""

    def record(self, names: Collection[str]) -> None:
        self.names = ('voltages',)


class Twice(Recording):
    """Offers two quantities of one name."""

    quantities = (VOLTAGES, VOLTAGES)


class NoQuantities(Recording):
    """Offers texts."""

    quantities = ('voltages',)


class Disturbed(Recording):
    """Drives otherwise when it records."""

    def step(self, observation: Observation) -> WheelVelocities:
        super().step(observation)
        return WheelVelocities(1.0 + len(self.names), 1.0)


#: What the sentence about each must have.
BROKEN: dict[Callable[..., Any], str] = {
    WithoutMethod: 'expected a method record(names), got none',
    Flat: 'recorded voltages: expected an array of the shape (1, 2), got one of (2,)',
    Nameless: 'recorded spikes: expected SpikeTimes of sources below 2',
    Late: 'recorded spikes: expected SpikeTimes of sources below 2, within a step',
    Silent: 'recorded spikes: expected SpikeTimes of sources below 2, within a step, in the order',
    Twice: 'shown.quantities: expected different names, got voltages, voltages',
    NoQuantities: "shown.quantities: expected a tuple of Quantity, got ('voltages',)",
    Disturbed: 'expected the same answers with a recording, got different ones',
}


def test_a_controller_that_records_what_it_offers_passes() -> None:
    """And is recorded."""
    assert check_controller('mine', Recording) == []
    lap = spikelane.drive(
        Recording(None),
        engine='kinematic',
        parameters={'simulator.episode.max_steps': 4},
        record=['all'],
    )
    assert lap.recorded('voltages')['value'].tolist() == [0.1, 0.2] * 5
    assert lap.recorded('spikes')['neuron'].tolist() == ['two', 'one'] * 5


@pytest.mark.parametrize('cls', BROKEN, ids=lambda cls: cls.__name__)
def test_what_is_recorded_wrongly_is_named(cls: Any) -> None:
    """With the controller, and one sentence."""
    [found] = check_controller('mine', cls)
    assert found.startswith('mine: recording: ')
    assert BROKEN[cls] in found
