"""Checks a controller against the contract, as Gymnasium's check_env does with environments.

What needs no simulator of its own and no ROS is here; `spikelane.check` adds trainings and ROS.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
import contextlib
import dataclasses
import math
from pathlib import Path
import random
import tempfile
from typing import Any, cast

import numpy as np

from spikelane_controllers.change_check import check_changes
from spikelane_controllers.checkpoint import read_checkpoint, write_checkpoint
from spikelane_controllers.controller_host import image_size
from spikelane_controllers.learning.learning_controller import check_can_learn, LearningController
from spikelane_controllers.learning.training import controller_state, state_checkpoint
from spikelane_controllers.operations import Operations
from spikelane_controllers.recording_check import check_recording
from spikelane_controllers.registry import ControllerClass
from spikelane_controllers.shown import Shown, shown_by
from spikelane_sim.contract import (
    Controller,
    controller_rng,
    Observation,
    sensors_of,
    WheelVelocities,
)
from spikelane_sim.errors import one_line, SpikelaneError
from spikelane_sim.events import make_events, no_events
from spikelane_sim.parameters import Parameters
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

#: Steps of the drive that the controller is shown.
STEPS = 60

_MANY_EVENTS = 10_000
_SEED = 7

Answers = list[WheelVelocities]


class Violations:
    """Collects violations, each one sentence; the same one is kept once."""

    def __init__(self, name: str) -> None:
        """Begin without any.

        Args:
            name: Name of the controller.
        """
        self._name = name
        self.found: list[str] = []

    def add(self, rule: str, expected: str, got: str) -> None:
        """Add a violation: the rule, what was expected and what came."""
        self._add(rule, f'expected {expected}, got {got}')

    @contextlib.contextmanager
    def guard(self, rule: str) -> Iterator[None]:
        """Make a violation of any exception within the block."""
        try:
            yield
        except SpikelaneError as error:  # says itself what was expected and what came
            self._add(rule, str(error))
        except Exception as error:  # the controller is foreign code
            self.add(rule, 'no exception', f'{type(error).__name__}: {error!s:.200}')

    def _add(self, rule: str, what: str) -> None:
        text = one_line(f'{self._name}: {rule}: {what}')
        if text not in self.found:
            self.found.append(text)


def check_controller(
    name: str, cls: ControllerClass, parameters: Mapping[str, Any] | None = None
) -> list[str]:
    """Check a controller's class against the contract of controllers.

    Args:
        name: Name of the controller, in the registry.
        cls: Its class.
        parameters: Its parameters under dotted names; what is absent is default.

    Returns:
        All violations, one sentence each; none where the controller keeps the contract.
    """
    violations = Violations(name)
    made = _make(violations, cls, parameters or {})
    if made is None:
        return violations.found
    make, values = made
    observations: list[Observation] = []
    with violations.guard('attribute sensors'):
        observations = _observations(values, sensors_of(cls))
    if not observations:
        return violations.found
    checks: dict[str, Callable[[], None]] = {
        'reset and step': lambda: _check_drive(violations, make, observations),
        'same seed, same answers': lambda: _check_determinism(violations, make, observations),
        'odd observations': lambda: _check_odd(violations, make, observations[0]),
        'recording': lambda: check_recording(make, _drives(observations)),
        'parameters that may be changed': lambda: check_changes(
            cls, values, lambda controller: _drive(controller, observations)
        ),
    }
    if hasattr(cls, 'state') or hasattr(cls, 'restore') or 'learning' in values.to_dict():
        checks['learning'] = lambda: _check_learner(violations, name, make, observations)
    else:
        checks['reset'] = lambda: _check_reset(violations, make, observations)
    for rule, check in checks.items():
        with violations.guard(rule):
            check()
    return violations.found


def _make(
    violations: Violations, cls: ControllerClass, given: Mapping[str, Any]
) -> tuple[Callable[[], Controller], Parameters] | None:
    """Return what makes the controller, and its parameters; None where it cannot be made."""
    parameters_class = getattr(cls, 'parameters_class', None)
    if not (isinstance(parameters_class, type) and issubclass(parameters_class, Parameters)):
        expected = 'a class derived from Parameters'
        violations.add('parameters_class', expected, f'{parameters_class!r:.80}')
        return None
    if not dataclasses.is_dataclass(parameters_class):
        violations.add('parameters_class', 'a dataclass', parameters_class.__name__)
        return None
    values = parameters_class.from_mapping(given)
    with violations.guard('construction from parameters_class'):
        controller = cls(values)
        lacking = [
            each for each in ('reset', 'step') if not callable(getattr(controller, each, None))
        ]
        for each in lacking:
            violations.add(f'method {each}', 'a method', 'none')
        return None if lacking else (lambda: cls(values), values)
    return None


def _observations(parameters: Parameters, sensors: Collection[str]) -> list[Observation]:
    """Return the observations of a drive straight ahead."""
    width, height = image_size(parameters)
    simulated = {'robot.engine': 'kinematic', 'camera.width': width, 'camera.height': height}
    made = SimulatorParameters.from_mapping(simulated)
    with Simulator(made, sensors=sensors) as simulator:
        seen = [simulator.reset('outer', _SEED)]
        seen += [simulator.step(WheelVelocities(1.0, 1.0)) for _ in range(STEPS)]
    return seen


def _drive(controller: Controller, seen: Sequence[Observation], episode: int = 1) -> Answers:
    """Return the answers of an episode, each observation given as a copy."""
    controller.reset(controller_rng(_SEED, episode))
    return _answers(controller, seen)


def _drives(seen: Sequence[Observation]) -> Callable[[Controller, Callable[[], None]], Answers]:
    """Return what drives an episode and calls a function after each answer."""

    def drive(controller: Controller, after: Callable[[], None]) -> Answers:
        controller.reset(controller_rng(_SEED, 1))
        answers = []
        for each in seen:
            answers.append(controller.step(each._replace(events=each.events.copy())))
            after()
        return answers

    return drive


def _answers(controller: Controller, seen: Sequence[Observation]) -> Answers:
    return [controller.step(each._replace(events=each.events.copy())) for each in seen]


def _same(some: object, others: object) -> bool:
    """Return whether answers are the same, bit for bit; NaN is the same as NaN."""
    return repr(some) == repr(others)


def _check_drive(
    violations: Violations, make: Callable[[], Controller], seen: Sequence[Observation]
) -> None:
    """Check answers, attributes, and that nothing is changed that belongs to others."""
    before = _global_random_state()
    controller = make()
    controller.reset(controller_rng(_SEED, 1))
    for each in seen:
        given = each._replace(events=each.events.copy())
        _check_wheels(violations, controller.step(given))
        if given.events.tobytes() != each.events.tobytes():
            violations.add('events given to step', 'unchanged events', 'changed events')
        _check_shown(violations, controller)
    if _global_random_state() != before:
        expected = 'all randomness from the generator given to reset'
        violations.add('global random state', expected, 'a changed global random state')


def _global_random_state() -> tuple[object, ...]:
    """Return the state of all generators that belong to nobody."""
    return repr(np.random.get_state()), random.getstate()  # noqa: NPY002  # others may use it


def _check_wheels(violations: Violations, wheels: object, to: str = '') -> None:
    rule = f'answer of step{to}'
    if not isinstance(wheels, WheelVelocities):
        violations.add(rule, 'WheelVelocities', type(wheels).__name__)
    elif not all(isinstance(each, float) for each in wheels):
        kinds = ', '.join(type(each).__name__ for each in wheels)
        violations.add(rule, 'two floats', kinds)
    elif not all(math.isfinite(each) for each in wheels):
        violations.add(rule, 'finite floats', f'{wheels.left}, {wheels.right}')


def _is_counts(value: object, number: int) -> bool:
    try:
        counts = list(cast(Any, value))
    except TypeError:
        return False
    return len(counts) == number and all(isinstance(e, int) and 0 <= e < 2**32 for e in counts)


def _is_names(value: object) -> bool:
    return isinstance(value, tuple | list) and all(isinstance(each, str) for each in value)


def _check_shown(violations: Violations, controller: object) -> None:
    """Check what it shows: the nodes publish that, and results are made of it."""
    learning = getattr(controller, 'learning', False)
    if not isinstance(learning, bool):
        violations.add('attribute learning', 'a bool', f'{learning!r:.80}')
    shown = getattr(controller, 'shown', Shown())
    if not isinstance(shown, Shown):
        violations.add('attribute shown', 'a record of the type Shown', f'{shown!r:.80}')
        return
    is_named, action = _is_names(shown.neurons), shown.action
    operations = shown.operations
    checks = {
        'neurons': ('a tuple or list of str', is_named),
        'spikes': (
            'one int from 0 to 2^32 - 1 for each of neurons',
            is_named and _is_counts(shown.spikes, len(shown.neurons)),
        ),
        'action': ('an int of 32 bits', isinstance(action, int) and -(2**31) <= action < 2**31),
        'reward': ('a float, NaN for none', isinstance(shown.reward, float)),
        'operations': (
            'Operations, or None',
            operations is None or isinstance(operations, Operations),
        ),
        'weights_pa': ('an array of finite floats, or None', _is_weights(shown.weights_pa)),
    }
    for name, (expected, is_right) in checks.items():
        if not is_right:
            violations.add(f'shown.{name}', expected, f'{getattr(shown, name)!r:.80}')


def _is_weights(value: object) -> bool:
    if value is None:
        return True
    is_float = isinstance(value, np.ndarray) and value.dtype.kind == 'f'
    return is_float and bool(np.isfinite(cast(Any, value)).all())


def _check_determinism(
    violations: Violations, make: Callable[[], Controller], seen: Sequence[Observation]
) -> None:
    one, other = make(), make()
    for episode in (1, 2):
        if not _same(_drive(one, seen, episode), _drive(other, seen, episode)):
            violations.add(
                'same seed, same answers',
                'the same answers of two controllers that were made alike',
                f'different answers in episode {episode}',
            )
            return


def _check_reset(
    violations: Violations, make: Callable[[], Controller], seen: Sequence[Observation]
) -> None:
    if not _repeats(make(), seen):
        expected = 'the same answers again after reset with the same seed'
        violations.add('reset', expected, 'different answers')


def _repeats(controller: Controller, seen: Sequence[Observation]) -> bool:
    """Return whether an episode that is driven twice is answered the same."""
    return _same(_drive(controller, seen), _drive(controller, seen))


def _check_odd(violations: Violations, make: Callable[[], Controller], first: Observation) -> None:
    """Check observations that are rare in a simulation."""
    stamp_ns = first.stamp_ns
    many = make_events(np.full(_MANY_EVENTS, stamp_ns), 0, 0, 1)
    odd = {
        'without events': first._replace(events=no_events()),
        f'with {_MANY_EVENTS} events at one pixel': first._replace(events=many),
        'without a lane': first._replace(lane=None),
        'with neither events nor a lane': first._replace(events=no_events(), lane=None),
    }
    for what, observation in odd.items():
        with violations.guard(f'observation {what}'):
            controller = make()
            controller.reset(controller_rng(_SEED, 1))
            for _ in range(20):  # some act only at every tenth
                _check_wheels(
                    violations, controller.step(observation), f' to an observation {what}'
                )


def _check_learner(
    violations: Violations,
    name: str,
    make: Callable[[], Controller],
    seen: Sequence[Observation],
) -> None:
    with violations.guard('what training needs'):
        check_can_learn(name, make())
    with violations.guard('state and restore'):
        _check_state(violations, name, cast('Callable[[], LearningController]', make), seen)
    with violations.guard('learning off'):
        _check_not_learning(violations, make, seen)


def _check_state(
    violations: Violations,
    name: str,
    make: Callable[[], LearningController],
    seen: Sequence[Observation],
) -> None:
    """Check that a controller goes on the same after it was written to a file."""
    half = len(seen) // 2 + 3  # not where an action ends
    controller, restored = make(), make()
    _drive(controller, seen[:half])
    state = controller.state()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, 'checkpoint.safetensors')
        write_checkpoint(path, name, *state_checkpoint(state))
        restored.restore(controller_state(read_checkpoint(path, name)))
    for each in (seen[half:], None):
        answers = [
            _drive(one, seen, 2) if each is None else _answers(one, each)
            for one in (controller, restored)
        ]
        if not _same(*answers):
            when = 'after the next reset' if each is None else 'in the same episode'
            expected = 'the same answers after restore from a checkpoint file'
            violations.add('state and restore', expected, f'different answers {when}')
            return


def _check_not_learning(
    violations: Violations, make: Callable[[], Controller], seen: Sequence[Observation]
) -> None:
    """Check that nothing is learnt while `learning` is False.

    Where the weights are visible, they must stay the same. Otherwise an episode that is
    repeated must be answered as before.
    """
    controller = make()
    controller.learning = False  # type: ignore[attr-defined]
    weights = shown_by(controller).weights_pa
    if weights is None:
        if not _repeats(controller, seen):
            expected = 'the same answers again after reset with the same seed'
            violations.add('learning off', expected, 'different answers')
        return
    before = np.array(weights)
    _drive(controller, seen)
    if not np.array_equal(before, cast(Any, shown_by(controller).weights_pa)):
        violations.add('learning off', 'weights_pa that stay the same', 'changed weights')
