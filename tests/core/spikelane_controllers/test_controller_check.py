"""The check of a controller against its contract: what passes, and what is found."""

# ruff: noqa: D102  # what the methods are for stands in the contract

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
import dataclasses
import json
import math
from pathlib import Path
import random
from typing import Any, ClassVar

import numpy as np
import pytest

from spikelane.check import check
from spikelane.main import run
from spikelane_controllers import registry
from spikelane_controllers.controller_check import check_controller
from spikelane_controllers.learning.learning_controller import (
    check_can_learn,
    check_learning_parameters,
)
from spikelane_controllers.saved_state import number, SavedState
from spikelane_controllers.shown import Shown
from spikelane_sim.contract import Observation, WheelVelocities
from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import NEXT_STEP, parameter, Parameters

Install = Callable[..., None]

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
    """Parameters of a controller that keeps the contract."""

    speed_rad_s: float = parameter(1.0, 'Speed of both wheels.', unit='rad/s', low=0.0, high=10.0)


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


class NeedsFewEvents(Plain):
    """Has room for a hundred events."""

    def step(self, observation: Observation) -> Any:
        np.zeros(100)[: len(observation.events)] = observation.events['x']
        return super().step(observation)


class NeedsEventsOrLane(Plain):
    """Can do without one, but not without both."""

    def step(self, observation: Observation) -> Any:
        if observation.lane is None:
            observation.events['x'].max()
        return super().step(observation)


class NanWithoutLane(Plain):
    """Answers with NaN where nobody knows the lane."""

    def step(self, observation: Observation) -> Any:
        lane = observation.lane
        return WheelVelocities(1.0, math.nan if lane is None else lane.distance_m)


class OddShown(Plain):
    """Shows what no message takes, several times."""

    shown: Any = Shown(('left', 'right'), (1,), 0.5, 1, 7)  # type: ignore[arg-type]


class NamesOfNumbers(Plain):
    """Names neurons by numbers."""

    shown = Shown(neurons=(1, 2))  # type: ignore[arg-type]


class BadWeights(Plain):
    """Has weights that are not finite."""

    shown = Shown(weights_pa=np.array([math.inf]))


class NoParameters(Plain):
    """Has a dictionary in the place of parameters."""

    parameters_class = dict


class _NotADataclass(Parameters):
    pass


class OddParameters(Plain):
    """Has parameters that are not a dataclass."""

    parameters_class = _NotADataclass


class CannotBeMade(Plain):
    """Takes no parameters."""

    def __init__(self) -> None:
        super().__init__(None)


class Failing(Plain):
    """Cannot drive at all."""

    def step(self, observation: Observation) -> Any:
        raise IndexError('no neuron 3')


class StandardRandom(Plain):
    """Draws from Python's global generator."""

    def step(self, observation: Observation) -> Any:
        return WheelVelocities(1.0, random.random())


class NoReset(Plain):
    """Has something else in the place of reset."""

    reset = None  # type: ignore[assignment]


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
    StandardRandom: 'global random state: expected all randomness from the generator given to',
    Mutating: 'events given to step: expected unchanged events, got changed events',
    HalfReset: 'reset: expected the same answers again after reset with the same seed',
    NeedsLane: 'observation without a lane: expected no exception, got AttributeError',
    NeedsEvents: 'observation without events: expected no exception, got ValueError',
    NeedsFewEvents: 'observation with 10000 events at one pixel: expected no exception, got Value',
    NeedsEventsOrLane: 'observation with neither events nor a lane: expected no exception, got V',
    NanWithoutLane: 'answer of step to an observation without a lane: expected finite floats, got',
    OddShown: 'shown.spikes: expected one int from 0 to 2^32 - 1 for each of neurons',
    NamesOfNumbers: 'shown.neurons: expected a tuple or list of str, got (1, 2)',
    BadWeights: 'shown.weights_pa: expected an array of finite floats, or None, got array([inf])',
    NoParameters: "parameters_class: expected a class derived from Parameters, got <class 'dict'>",
    OddParameters: 'parameters_class: expected a dataclass, got _NotADataclass',
    CannotBeMade: 'construction from parameters_class: expected no exception, got TypeError: ',
    Failing: 'reset and step: expected no exception, got IndexError: no neuron 3',
    NoReset: 'method reset: expected a method, got none',
    NoStep: 'method step: expected a method, got none',
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class LearnerParameters(PlainParameters):
    """Parameters of a controller that learns."""

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

    def state(self) -> SavedState:
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


class LearnerWithoutSteps(Learner):
    """Does not restore all of its state."""

    def restore(self, state: Mapping[str, Any]) -> None:
        super().restore(state)
        self.steps = 0


class AlwaysLearns(Learner):
    """Learns though it must not."""

    def step(self, observation: Observation) -> WheelVelocities:
        self.learnt += 0.001
        return super().step(observation)


class AlwaysChangesWeights(Learner):
    """Shows weights, and changes them though it must not."""

    def __init__(self, parameters: Any) -> None:
        super().__init__(parameters)
        self.shown = Shown(weights_pa=np.zeros(2))

    def step(self, observation: Observation) -> WheelVelocities:
        assert self.shown.weights_pa is not None
        self.shown = Shown(weights_pa=self.shown.weights_pa + 1.0)
        return super().step(observation)


class LearningByNumber(Learner):
    """Says by a number whether it learns."""

    def __init__(self, parameters: Any) -> None:
        super().__init__(parameters)
        self.learning = 0  # type: ignore[assignment]


class ForgetsWhatWasLearnt(Learner):
    """Restores the episode, but the next one begins with what the first one learnt."""

    def __init__(self, parameters: Any) -> None:
        super().__init__(parameters)
        self.drives = 0

    def reset(self, rng: np.random.Generator) -> None:
        super().reset(rng)
        self.drives += 1
        self.learnt += 0.1 * self.drives


class NoInitialise(Learner):
    """Has nothing to begin a training with."""

    initialise = None  # type: ignore[assignment]


class NoCheckpoint(Learner):
    """Cannot be told where to begin."""

    @dataclasses.dataclass(frozen=True, kw_only=True)
    class _Parameters(PlainParameters):
        learning: bool = parameter(False, 'Whether anything changes.')

    parameters_class = _Parameters


class OtherParameters(Learner):
    """Keeps its parameters in a dictionary."""

    def __init__(self, parameters: Any) -> None:
        super().__init__(parameters)
        self.parameters = parameters.to_dict()


class StateOfText(Learner):
    """Has a state that no checkpoint takes."""

    def state(self) -> SavedState:
        return {**super().state(), 'rng': object()}


BROKEN_LEARNERS = {
    WithoutParameters: "a controller that can be trained, got one without attribute 'parameters'",
    NoInitialise: "a controller that can be trained, got one without method 'initialise'",
    OtherParameters: 'expected an attribute parameters of its parameters_class, got {',
    NoCheckpoint: "expected a parameter 'checkpoint' of type str, got none",
    LearningByNumber: 'attribute learning: expected a bool, got 0',
    LearnerWithoutSteps: 'different answers in the same episode',
    ForgetsWhatWasLearnt: 'different answers after the next reset',
    StateOfText: 'state and restore: expected no exception, got TypeError',
    AlwaysLearns: 'learning off: expected the same answers again after reset with the same seed',
    AlwaysChangesWeights: 'learning off: expected weights_pa that stay the same, got changed',
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


@dataclasses.dataclass(frozen=True, kw_only=True)
class PacedParameters(Parameters):
    """A parameter that may be changed."""

    speed_rad_s: float = parameter(1.0, 'Speed.', low=0.0, high=10.0, changes=NEXT_STEP)


class Paced(Plain):
    """Drives at a speed, and takes another one."""

    parameters_class: ClassVar[Any] = PacedParameters

    def change(self, parameters: Any) -> None:
        self.parameters = parameters

    def step(self, observation: Observation) -> Any:
        return WheelVelocities(self.parameters.speed_rad_s, super().step(observation).right)


class Deaf(Paced):
    """Goes on as before."""

    def change(self, parameters: Any) -> None:
        del parameters


class Unchangeable(Plain):
    """Has no method for it."""

    parameters_class: ClassVar[Any] = PacedParameters


def test_what_may_be_changed_can_be() -> None:
    """With the answers of a start with the new value."""
    assert check_controller('mine', Paced) == []
    assert check_controller('mine', Deaf) == [
        'mine: parameters that may be changed: speed_rad_s: expected the same answers after a '
        'change as from the start, got different ones'
    ]
    assert check_controller('mine', Unchangeable) == [
        'mine: parameters that may be changed: speed_rad_s: expected a method '
        'change(parameters) of the controller, since the parameter may be changed, got none'
    ]


def test_all_violations_are_reported() -> None:
    """Each attribute of the wrong type has its sentence."""
    found = check_controller('mine', OddShown)
    rules = [each.split(': ')[1] for each in found]
    kinds = ('spikes', 'action', 'reward', 'operations')
    assert rules == [f'shown.{kind}' for kind in kinds]


@pytest.mark.parametrize(
    ('name', 'parameters'),
    [('braitenberg', {}), ('rstdp', {}), ('dqn_snn', {}), ('dqn', SMALL_DQN)],
)
def test_every_shipped_controller_passes(name: str, parameters: dict[str, Any]) -> None:
    """Also trained and resumed, where it learns."""
    assert check(name, 'inprocess', parameters) == []


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Install]:
    """Give what installs controllers of another package, with the usual training."""

    def write_entry_points(**classes: str) -> None:
        trained = [name for name in classes if 'learn' in classes[name].lower()]
        info = tmp_path / 'my_controllers-0.1.0.dist-info'
        info.mkdir()
        (info / 'METADATA').write_text('Metadata-Version: 2.1\nName: my_controllers\n')
        lines = ['[spikelane.controllers]', *(f'{name} = {cls}' for name, cls in classes.items())]
        lines += ['[spikelane.trainings]']
        lines += [f'{name} = spikelane_controllers.learning.training:Training' for name in trained]
        (info / 'entry_points.txt').write_text('\n'.join(lines))
        monkeypatch.syspath_prepend(str(tmp_path))
        registry._entries.cache_clear()

    yield write_entry_points
    registry._entries.cache_clear()


@pytest.mark.parametrize('name', ['balance', 'learning_balance'])
def test_the_examples_pass(name: str, install: Install, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a package of its own, found by its entry points."""
    monkeypatch.syspath_prepend(str(EXAMPLE))
    install(
        balance='my_controllers.balance:Balance',
        learning_balance='my_controllers.learning_balance:LearningBalance',
    )
    assert check(name, 'inprocess', {}) == []


def test_a_controller_that_passes_ends_the_command_with_0(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    """In one line, or as one JSON object."""
    install(mine=f'{__name__}:Learner')
    assert run(['check', 'mine']) == 0
    assert capsys.readouterr() == ('mine: no violation of the contract\n', '')
    assert run(['check', 'mine', '--json']) == 0
    assert json.loads(capsys.readouterr().out) == {
        'controller': 'mine',
        'transport': 'inprocess',
        'passed': True,
        'violations': [],
    }


def test_the_trainings_parameters_can_be_given(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    """They are a group like any other where a controller is trained."""
    install(mine=f'{__name__}:Learner')
    assert run(['check', 'mine', '--param', 'training.save_every=20']) == 0
    assert capsys.readouterr().out == 'mine: no violation of the contract\n'


def test_a_violation_ends_the_command_with_1(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    """A training shows it, too: it does not go on as if it had not been interrupted."""
    install(mine=f'{__name__}:LearnerWithoutSteps')
    assert run(['check', 'mine', '--json']) == 1
    told = json.loads(capsys.readouterr().out)
    violations = [
        'mine: state and restore: expected the same answers after restore from a checkpoint file, '
        'got different answers in the same episode',
        'mine: resumed training: expected the checkpoint of a training that was not interrupted, '
        'got another checkpoint',
    ]
    assert (told['passed'], told['violations']) == (False, violations)
    assert run(['check', 'mine']) == 1
    assert capsys.readouterr().out.splitlines() == violations


@pytest.mark.parametrize(
    ('arguments', 'error'),
    [
        (['nobody'], 'argument controller: invalid choice: '),
        (['braitenberg', '--param', 'braitenberg.nothing=1'], "unknown parameter 'nothing'"),
        (['braitenberg', '--param', 'braitenberg.steering.v_max=-1'], 'v_max: expected'),
        (['braitenberg', '--param', 'training.save_every=9'], 'expected braitenberg.<name>'),
        (['rstdp', '--param', 'training.save=9'], "unknown parameter 'save'"),
        (['rstdp', '--param', 'training.steps=9'], 'training.steps: expected none'),
    ],
)
def test_wrong_use_ends_the_command_with_2(
    arguments: list[str], error: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing is printed but the error."""
    try:
        status = run(['check', *arguments, '--json'])
    except SystemExit as ended:
        status = ended.code
    assert status == 2
    out, err = capsys.readouterr()
    assert (out, err.count('\n')) == ('', 1)
    assert error in err


def test_who_cannot_be_trained_is_told_what_it_lacks() -> None:
    """One sentence for attributes and methods, one for each parameter."""
    lacking = r"got one without attribute 'parameters'$"
    with pytest.raises(ParameterError, match=lacking):
        check_can_learn('mine', WithoutParameters(LearnerParameters()))
    check_can_learn('mine', Learner(LearnerParameters()))
    specs = {spec.name: spec for spec in PlainParameters.specs()}
    with pytest.raises(ParameterError, match=r"a parameter 'learning' of type bool, got none$"):
        check_learning_parameters('mine', specs)
