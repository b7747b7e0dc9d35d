"""What hosts a controller: resets where episodes begin, and the size of its image."""

import dataclasses

import numpy as np
import pytest

from spikelane_controllers.braitenberg.controller import BraitenbergParameters
from spikelane_controllers.controller_host import ControllerHost, image_size
from spikelane_sim.contract import controller_rng, LaneState, Observation, WheelVelocities
from spikelane_sim.encoding import StateImageParameters
from spikelane_sim.errors import ParameterError
from spikelane_sim.events import no_events
from spikelane_sim.parameters import nested, NEXT_EPISODE, NEXT_STEP, parameter, Parameters


class Drawing:
    """A controller that answers with the next number of its generator."""

    def reset(self, rng: np.random.Generator) -> None:
        """Begin an episode."""
        self._rng = rng

    def step(self, observation: Observation) -> WheelVelocities:
        """Draw."""
        del observation
        return WheelVelocities(self._rng.random(), 0.0)


def observation(episode: int, step: int) -> Observation:
    """Return an observation of an episode; of none where it is 0."""
    lane = LaneState('outer', 0.0, 0.0, 0.0, 'A', 0.0, 0, episode, step, False, '')
    return Observation(0, no_events(), lane if episode else None)


def drawn(*places: tuple[int, int]) -> list[float]:
    """Return what is answered to observations of these episodes and steps, with seed 3."""
    host = ControllerHost(Drawing(), 3)
    return [host.step(observation(*place)).left for place in places]


def numbers(episode: int, count: int) -> list[float]:
    """Return the first numbers of an episode."""
    return controller_rng(3, episode).random(count).tolist()


def test_a_controller_is_reset_where_an_episode_begins() -> None:
    """By its number, or as its steps begin again; a gap is no beginning."""
    assert drawn((1, 0), (1, 1), (2, 0)) == numbers(1, 2) + numbers(2, 1)
    assert drawn((1, 0), (1, 1), (1, 0), (1, 1)) == numbers(1, 2) * 2
    assert drawn((1, 0), (1, 0), (1, 1)) == numbers(1, 1) + numbers(1, 2)
    assert drawn((1, 4), (1, 9), (1, 3)) == numbers(1, 2) + numbers(1, 1)
    assert drawn((1, 4), (1, 9), (1, 10)) == numbers(1, 3)
    assert drawn((1, 4), (2, 9)) == numbers(1, 1) + numbers(2, 1)


def test_a_step_seen_twice_is_in_the_same_episode() -> None:
    """As after a reset of time alone, which observes the robot once more where it is."""
    assert drawn((1, 0), (1, 1), (1, 1), (1, 2)) == numbers(1, 4)


def test_without_lane_states_there_is_one_episode() -> None:
    """Number 0; or the one that was there, where they are missing in between."""
    assert drawn((0, 0), (0, 0), (0, 0)) == numbers(0, 3)
    assert drawn((1, 0), (0, 0), (1, 2)) == numbers(1, 3)


def stamped(step: int, stamp_ms: int) -> Observation:
    """Return an observation of episode 1."""
    return observation(1, step)._replace(stamp_ns=stamp_ms * 1_000_000)


def test_a_simulator_with_another_period_is_refused() -> None:
    """Two steps in a row tell; a gap, a new episode or a reset of time tells nothing."""
    host = ControllerHost(Drawing(), 3, period_ms=50)
    for step, stamp_ms in ((0, 50), (1, 100), (2, 400), (4, 410), (4, 10), (0, 20)):
        host.step(stamped(step, stamp_ms))
    expected = 'period_ms: expected 10 ms, as the simulator steps, got 50'
    with pytest.raises(ParameterError, match=expected):
        host.step(stamped(1, 30))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Slow(Parameters):
    """Parameters that may be changed."""

    left: float = parameter(0.0, 'Velocity.', changes=NEXT_STEP)
    right: float = parameter(0.0, 'Velocity.', changes=NEXT_EPISODE)


class Changing(Drawing):
    """A controller that answers with its parameters."""

    def __init__(self) -> None:
        self.change(Slow())

    def change(self, parameters: Slow) -> None:
        """Take others."""
        self.parameters = parameters

    def step(self, observation: Observation) -> WheelVelocities:
        """Say them."""
        return WheelVelocities(self.parameters.left, self.parameters.right)


def test_parameters_change_between_two_steps() -> None:
    """One with the next step, the other with the next episode."""
    host = ControllerHost(Changing(), 3, Slow())
    assert host.changing is not None
    answers = [host.step(observation(1, 0))]
    host.changing.change({'left': 1.0, 'right': 2.0})
    answers += [host.step(observation(*place)) for place in ((1, 1), (1, 2), (2, 0))]
    assert answers == [(0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (1.0, 2.0)]


def test_a_controller_that_takes_no_changes_is_refused_where_it_declares_some() -> None:
    """At the start, and not when somebody sets a parameter."""
    with pytest.raises(ParameterError, match=r'^left: expected a method change\(parameters\) of'):
        ControllerHost(Drawing(), 3, Slow())


@dataclasses.dataclass(frozen=True, kw_only=True)
class Bare(Parameters):
    """Parameters of a controller without an image."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Deep(Parameters):
    """Parameters of a controller with another image."""

    image: StateImageParameters = nested(StateImageParameters)


def test_the_image_is_the_encodings() -> None:
    """Whatever its name; a DVS128's where there is none."""
    wide = {'encoding.width': 256, 'encoding.cell': 32, 'encoding.height': 192}
    assert image_size(BraitenbergParameters.from_mapping(wide)) == (256, 192)
    assert image_size(Deep.from_mapping({'image.width': 64})) == (64, 128)
    assert image_size(Bare()) == (128, 128)
