"""Parameters that change while they are in use: which, when, and that nothing else does."""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
import hashlib
from typing import Any

import pytest

from spikelane_sim.contract import WheelVelocities
from spikelane_sim.errors import ParameterError
from spikelane_sim.parameter_changes import ChangingParameters, ParameterChange
from spikelane_sim.parameters import NEXT_EPISODE, NEXT_STEP, parameter, Parameters
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

STEP_NS = 50_000_000
COPPELIA = {'robot.model': 'kinematic'}
ESIM = {**COPPELIA, 'pixels.model': 'esim', 'pixels.esim.substeps': 2}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Two(Parameters):
    """A pair in order, one of which changes with a step and one with an episode."""

    low: float = parameter(1.0, 'Lower one.', low=0.0, changes=NEXT_STEP)
    high: float = parameter(2.0, 'Higher one.', high=10.0, changes=NEXT_EPISODE)
    name: str = parameter('', 'Fixed.')

    def _check_relations(self) -> None:
        if self.low > self.high:
            raise ParameterError(f'low: expected at most high = {self.high:g}, got {self.low:g}')


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'name': 'x'}, 'name: fixed since the start; only low, high can be changed'),
        ({'other': 1.0}, "unknown parameter 'other'"),
        ({'low': -1.0}, 'low: expected a number of at least 0, got -1.0'),
        ({'low': 'much'}, "low: expected a number of at least 0, got 'much'"),
        ({'low': 1.5, 'high': 11.0}, 'high: expected a number of at most 10, got 11.0'),
        ({'low': 3.0}, 'low: expected at most high = 2, got 3'),
        # The lower one would be above the higher one until the next episode.
        ({'low': 3.0, 'high': 4.0}, 'low: expected at most high = 2, got 3'),
    ],
)
def test_what_is_not_allowed_is_refused_with_all_that_comes_with_it(
    values: Mapping[str, Any], message: str
) -> None:
    """In the words of the start; nothing has changed then."""
    changing = ChangingParameters(Two())
    with pytest.raises(ParameterError) as refused:
        changing.change(values)
    assert str(refused.value) == message
    assert not changing.take_effect(1, begins_episode=True)
    assert (changing.parameters, changing.log) == (Two(), [])


def test_each_takes_effect_when_its_time_has_come() -> None:
    """What is for the next step does so at the beginning of an episode, too."""
    changing = ChangingParameters(Two())
    changing.change({'low': 1, 'high': 4.0})
    assert not changing.take_effect(1, begins_episode=False)  # 1 is what it was
    changing.change({'low': 1.5})
    assert changing.take_effect(2, begins_episode=False)
    assert changing.parameters == Two(low=1.5)
    assert not changing.take_effect(3, begins_episode=False)
    assert changing.take_effect(4, begins_episode=True)
    assert changing.parameters == Two(low=1.5, high=4.0)
    changing.change({'low': 2.0, 'high': 5.0})
    assert changing.take_effect(5, begins_episode=True)
    assert changing.log == [
        ParameterChange(2, {'low': 1.5}),
        ParameterChange(4, {'high': 4.0}),
        ParameterChange(5, {'low': 2.0, 'high': 5.0}),
    ]
    assert not changing.take_effect(6, begins_episode=True)


def test_what_was_asked_for_twice_counts_as_asked_for_last() -> None:
    """And what has been taken back has never been."""
    changing = ChangingParameters(Two())
    changing.change({'high': 9.0})
    changing.change({'high': 3.0})
    assert changing.take_effect(1, begins_episode=True)
    assert changing.parameters.high == 3.0
    changing.change({'low': 2.5})
    changing.change({'low': 1.0})
    assert not changing.take_effect(2, begins_episode=False)


class Drive:
    """Episodes of 20 steps, and what was seen in each."""

    def __init__(self, parameters: Mapping[str, Any]) -> None:
        self.simulator = Simulator(SimulatorParameters.from_mapping(parameters))

    def episode(self, *, seed: int | None = None, **changes: Mapping[str, Any]) -> str:
        """Drive one; `at_3` is changed after three steps. Return a digest of it."""
        observation = self.simulator.reset('outer', seed)
        seen = hashlib.sha256()
        for step in range(20):
            self.simulator.change(changes.get(f'at_{step}', {}))
            observation = self.simulator.step(WheelVelocities(2.0 + step, 3.0))
            seen.update(observation.events.tobytes())
            seen.update(repr(self.simulator.robot_state).encode())
        return seen.hexdigest()


CASES = [
    (COPPELIA, 'pixels.coppelia.noise_rate_hz', 2.0, NEXT_STEP),
    (COPPELIA, 'link.event_loss', 0.3, NEXT_STEP),
    (COPPELIA, 'link.latency_ms', 100, NEXT_STEP),
    (ESIM, 'pixels.esim.leak_rate_hz', 3.0, NEXT_STEP),
    (ESIM, 'pixels.esim.shot_rate_hz', 3.0, NEXT_STEP),
    (ESIM, 'pixels.esim.hot_share', 0.01, NEXT_STEP),
    (ESIM, 'pixels.esim.threshold_spread', 0.1, NEXT_EPISODE),
]


@pytest.mark.parametrize(('usual', 'name', 'value', 'moment'), CASES, ids=lambda each: str(each))
def test_a_change_is_as_exact_as_a_start(
    usual: Mapping[str, Any], name: str, value: float, moment: str
) -> None:
    """Before an episode and amid one: the next episode has the bits of a start with the value."""
    begun = Drive({**usual, name: value})
    expected = [begun.episode(seed=3), begun.episode()]
    before = Drive(usual)
    before.simulator.change({name: value})
    assert [before.episode(seed=3), before.episode()] == expected
    assert before.simulator.changing.log == [ParameterChange(STEP_NS, {name: value})]
    amid, never = Drive(usual), Drive(usual)
    first = amid.episode(seed=3, at_3={name: value})
    assert amid.episode() == expected[1]
    assert (first == never.episode(seed=3)) == (moment == NEXT_EPISODE)
    stamp_ns = 5 * STEP_NS if moment == NEXT_STEP else 22 * STEP_NS
    assert amid.simulator.changing.log == [ParameterChange(stamp_ns, {name: value})]


def test_exactly_noise_and_the_link_change_in_a_simulator() -> None:
    """All else is fixed."""
    changing = Simulator(SimulatorParameters.from_mapping(COPPELIA)).changing
    assert {name: spec.changes for name, spec in changing.specs.items()} == {
        'pixels.coppelia.noise_rate_hz': 'next step',
        'pixels.esim.threshold_spread': 'next episode',
        'pixels.esim.leak_rate_hz': 'next step',
        'pixels.esim.shot_rate_hz': 'next step',
        'pixels.esim.shot_bright_factor': 'next step',
        'pixels.esim.hot_share': 'next step',
        'pixels.esim.hot_rate_hz': 'next step',
        'link.latency_ms': 'next step',
        'link.event_loss': 'next step',
    }
