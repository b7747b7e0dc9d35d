"""The check of a controller against its contract: what passes, and what is found."""

# ruff: noqa: D102  # what the methods are for stands in the contract

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
import math
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from spikelane.check import check
from spikelane_controllers import registry
from spikelane_controllers.controller_check import check_controller
from spikelane_controllers.learning_controller import check_can_learn, check_learning_parameters
from spikelane_controllers.state import number, State
from spikelane_sim.contract import Observation, WheelVelocities
from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import parameter, Parameters

EXAMPLE = Path(__file__).parents[3] / 'docs/examples/balance'
SMALL_DQN = {
    'dqn.checkpoint': '',
    'dqn.network.hidden_1': 8,
    'dqn.network.hidden_2': 6,
    'dqn.q_learning.random_steps': 10,
    'dqn.q_learning.buffer_size': 40,
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlainParameters(Parameters):
    """Of a controller that keeps the contract."""

    speed_rad_s: float = parameter(1.0, 'Of both wheels.', unit='rad/s', low=0.0, high=10.0)


class Plain:
    """Keeps the contract: turns with the number of steps, and at random."""

    parameters_class: ClassVar[Any] = PlainParameters

    def __init__(self, parameters: Any) -> None:
        self.parameters = parameters
        self.steps = 0

    def reset(self, rng: np.random.Generator) -> None:
        self.rng, self.steps = rng, 0

    def step(self, observation: Observation) -> Any:
        self.steps += 1
        return WheelVelocities(1.0, self.steps / 100 + float(self.rng.random()))


class Pair(Plain):
    """Answers with a tuple."""

    def step(self, observation: Observation) -> Any:
        return tuple(super().step(observation))


class Nan(Plain):
    """Answers with NaN."""

    def step(self, observation: Observation) -> Any:
        return WheelVelocities(math.nan, 1.0)


class Whole(Plain):
    """Answers with whole numbers."""

    def step(self, observation: Observation) -> Any:
        return WheelVelocities(1, 1)


class Unseeded(Plain):
    """Draws from a generator without a seed."""

    def reset(self, rng: np.random.Generator) -> None:
        super().reset(np.random.default_rng())


class Global(Plain):
    """Draws from NumPy's global generator."""

    def step(self, observation: Observation) -> Any:
        return WheelVelocities(1.0, float(np.random.rand()))  # noqa: NPY002


class Mutating(Plain):
    """Changes the events."""

    def step(self, observation: Observation) -> Any:
        observation.events['x'] += 1
        return super().step(observation)


class HalfReset(Plain):
    """Keeps the number of steps over a reset."""

    def reset(self, rng: np.random.Generator) -> None:
        self.rng = rng


class NeedsLane(Plain):
    """Cannot drive where nobody knows the lane."""

    def step(self, observation: Observation) -> Any:
        return WheelVelocities(1.0, observation.lane.distance_m)  # type: ignore[union-attr]


class NeedsEvents(Plain):
    """Cannot drive where there are no events."""

    def step(self, observation: Observation) -> Any:
        return WheelVelocities(1.0, float(observation.events['x'].max()))


class OddAttributes(Plain):
    """Has attributes that no message takes, and several of them."""

    neurons = ('left', 'right')
    spikes = (1,)
    action = 0.5
    reward = 1


class NoParameters(Plain):
    """Has a dictionary in the place of parameters."""

    parameters_class = dict


class NoStep:
    """Has no step."""

    parameters_class = PlainParameters

    def __init__(self, parameters: Any) -> None:
        del parameters

    def reset(self, rng: np.random.Generator) -> None:
        del rng


BROKEN = {
    Pair: 'answer of step: expected WheelVelocities, got tuple',
    Nan: 'answer of step: expected finite floats, got nan, 1.0',
    Whole: 'answer of step: expected two floats, got int, int',
    Unseeded: 'same seed, same answers: expected the same answers of two controllers',
    Global: 'global random state: expected all randomness from the generator given to reset',
    Mutating: 'events: expected events that step leaves as they are, got changed events',
    HalfReset: 'reset: expected the same answers again after reset with the same seed',
    NeedsLane: 'observation without a lane: expected no exception, got AttributeError',
    NeedsEvents: 'observation without events: expected no exception, got ValueError',
    OddAttributes: 'attribute spikes: expected one int from 0 to 2^32 - 1 for each of neurons',
    NoParameters: "parameters_class: expected a class derived from Parameters, got <class 'dict'>",
    NoStep: 'method step: expected a method, got none',
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class LearnerParameters(PlainParameters):
    """Of a controller that learns."""

    learning: bool = parameter(False, 'Whether anything changes.')
    checkpoint: str = parameter('', 'Where to begin.')


class Learner:
    """Learns a count of steps."""

    parameters_class: ClassVar[Any] = LearnerParameters

    def __init__(self, parameters: Any) -> None:
        self.parameters = parameters
        self.learning: bool = parameters.learning
        self.learnt, self.steps = 0.0, 0

    def initialise(self, rng: np.random.Generator) -> None:
        self.learnt = float(rng.random())

    def reset(self, rng: np.random.Generator) -> None:
        del rng
        self.steps = 0

    def step(self, observation: Observation) -> WheelVelocities:
        self.steps += 1
        self.learnt += 0.001 * self.learning
        return WheelVelocities(1.0 + self.learnt, self.steps / 100)

    def state(self) -> State:
        return {'learnt': self.learnt, 'steps': self.steps, 'learning': self.learning}

    def restore(self, state: Mapping[str, Any]) -> None:
        self.learnt = number(state, 'learnt', float)
        self.steps = number(state, 'steps', int)
        self.learning = number(state, 'learning', bool)


class WithoutParameters(Learner):
    """Keeps no parameters."""

    def __init__(self, parameters: Any) -> None:
        super().__init__(parameters)
        del self.parameters


class ForgetsSteps(Learner):
    """Does not restore all of its state."""

    def restore(self, state: Mapping[str, Any]) -> None:
        super().restore(state)
        self.steps = 0


class AlwaysLearns(Learner):
    """Learns though it must not."""

    def step(self, observation: Observation) -> WheelVelocities:
        self.learnt += 0.001
        return super().step(observation)


class StateOfText(Learner):
    """Has a state that no checkpoint takes."""

    def state(self) -> State:
        return {**super().state(), 'rng': object()}


BROKEN_LEARNERS = {
    WithoutParameters: "got one without attribute 'parameters'",
    ForgetsSteps: 'state and restore: expected the same answers after restore from a checkpoint',
    AlwaysLearns: 'reset: expected the same answers again after reset with the same seed',
    StateOfText: 'state and restore: expected no exception, got TypeError',
}


@pytest.mark.parametrize('cls', [Plain, Learner])
def test_a_controller_that_keeps_the_contract_passes(cls: Any) -> None:
    """Without a violation, whether it learns or not."""
    assert check_controller('mine', cls) == []


@pytest.mark.parametrize('cls', [*BROKEN, *BROKEN_LEARNERS], ids=lambda cls: cls.__name__)
def test_a_violation_is_named(cls: Any) -> None:
    """With the controller, the rule, what was expected and what came."""
    found = check_controller('mine', cls)
    assert any((BROKEN | BROKEN_LEARNERS)[cls] in each for each in found), found
    assert all(each.startswith('mine: ') and '\n' not in each for each in found)


def test_all_violations_are_reported() -> None:
    """Each attribute of the wrong type has its sentence."""
    found = check_controller('mine', OddAttributes)
    rules = [each.split(': ')[1] for each in found]
    assert rules == ['attribute spikes', 'attribute action', 'attribute reward']


@pytest.mark.parametrize(
    ('name', 'parameters'),
    [('braitenberg', {}), ('rstdp', {}), ('dqn_snn', {}), ('dqn', SMALL_DQN)],
)
def test_every_shipped_controller_passes(name: str, parameters: dict[str, Any]) -> None:
    """Also trained and resumed, where it learns."""
    assert check(name, 'inprocess', parameters) == []


@pytest.mark.parametrize('name', ['balance', 'learning_balance'])
def test_the_examples_pass(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """As a package of its own, found by its entry points."""
    info = tmp_path / 'my_controllers-0.1.0.dist-info'
    info.mkdir()
    (info / 'METADATA').write_text('Metadata-Version: 2.1\nName: my_controllers\n')
    (info / 'entry_points.txt').write_text(
        '[spikelane.controllers]\n'
        'balance = my_controllers.balance:Balance\n'
        'learning_balance = my_controllers.learning_balance:LearningBalance\n'
        '[spikelane.trainings]\n'
        'learning_balance = spikelane_controllers.training:Training\n'
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.syspath_prepend(str(EXAMPLE))
    registry._entries.cache_clear()
    try:
        assert check(name, 'inprocess', {}) == []
    finally:
        registry._entries.cache_clear()


def test_who_cannot_be_trained_is_told_what_it_lacks() -> None:
    """One sentence for attributes and methods, one for each parameter."""
    lacking = r"got one without attribute 'parameters'$"
    with pytest.raises(ParameterError, match=lacking):
        check_can_learn('mine', WithoutParameters(LearnerParameters()))
    check_can_learn('mine', Learner(LearnerParameters()))
    specs = {spec.name: spec for spec in PlainParameters.specs()}
    with pytest.raises(ParameterError, match=r"a parameter 'learning' of type bool, got none$"):
        check_learning_parameters('mine', specs)
