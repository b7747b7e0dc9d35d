"""Training by driving: a controller that learns, wrapped so that it remembers how it did.

The paper's procedure (sections 3.4 and 4.4): the robot drives, is reset when it leaves the lane,
has completed a lap (R-STDP) or has driven long enough (DQN), and the lanes alternate. In-process
and over ROS the same object receives the same observations, so that both give the same weights,
bit for bit.

A checkpoint is taken every so many steps. It holds the controller's state and the answers given
since the last reset: a resumed run resets the simulator to that episode, gives those answers once
more without learning anything, and is then exactly where it was. Simulation time restarts in
it, which nothing depends on.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.checkpoint import Arrays, Checkpoint, read_checkpoint, write_checkpoint
from spikelane_controllers.learning.learning_controller import LearningController
from spikelane_controllers.saved_state import array as state_array
from spikelane_controllers.saved_state import mapping, number, records, SavedState
from spikelane_sim.contract import (
    controller_rng,
    LaneState,
    Observation,
    WheelVelocities,
)
from spikelane_sim.errors import CheckpointChoiceError, CheckpointError
from spikelane_sim.parameters import first_difference, MOST_STEPS, parameter, Parameters
from spikelane_sim.simulator_parameters import current_config

#: Entry of a training's configuration: SHA-256 of the files that it names, where there are any.
INPUTS = 'inputs'

#: Prefix of the names that the controller's arrays have in a checkpoint.
_PREFIX = 'controller.'


@dataclass(frozen=True, kw_only=True)
class TrainingParameters(Parameters):
    """How long a training takes and how often it is saved."""

    steps: int = parameter(30_000, 'Steps of the training, of 50 ms each.', low=1, high=MOST_STEPS)
    save_every: int = parameter(
        100,
        'Steps between two checkpoints; a killed training loses at most these.',
        low=1,
        high=MOST_STEPS,
    )


class Termination(NamedTuple):
    """How an episode ended."""

    step: int  # of the training, when it ended
    episode: int
    lane: str
    section: str
    position_m: float
    distance_m: float
    episode_steps: int
    reason: str


class Start(NamedTuple):
    """The episode that a training begins or resumes with."""

    lane: str | None
    episode: int


class Training:
    """A learning controller in training; itself a `contract.Controller`.

    Either `begin` or `resume` comes first. Classes for controllers that need more override the
    methods below `_counts`.

    Attributes:
        controller: What learns.
        steps: Steps driven, as the class counts them.
        terminations: Terminations of all episodes.
        on_episode: Called after each episode.
        former_values: What parameters of the controller were before they could be chosen.
    """

    parameters_class: ClassVar[type[TrainingParameters]] = TrainingParameters
    former_values: ClassVar[Mapping[str, Any]] = {}

    def __init__(
        self,
        name: str,
        controller: LearningController,
        parameters: TrainingParameters,
        config: Mapping[str, Any],
        checkpoint: Path,
    ) -> None:
        """Prepare a training.

        Args:
            name: Name of the controller, in the registry.
            controller: Just made.
            parameters: Parameters of the training.
            config: What determines it, as a JSON-compatible dict; kept in checkpoints, compared by
                `resume`. `INPUTS` is passed over where a checkpoint does not have it.
            checkpoint: File of the checkpoints, ending in .safetensors.
        """
        self.controller = controller
        self.steps = 0
        self.terminations: list[Termination] = []
        self.on_episode: Callable[[], None] = lambda: None
        self._name = name
        self._parameters = parameters
        self._config = dict(config)
        self._checkpoint = checkpoint
        self._start = Start(None, 1)
        self._distance_m = 0.0  # at the last step
        # This episode's answers, left and right in turn; a list of pairs would take long to save.
        self._answers = array('d')
        self._n_replayed = 0
        self._needs_reset = False
        self._is_due = False

    def begin(self, seed: int) -> None:
        """Begin with initial weights that depend on the seed alone, and save that.

        Raises:
            CheckpointError: There is another training's checkpoint.
            FileError: The checkpoint cannot be written.
        """
        if self._checkpoint.exists():
            raise CheckpointChoiceError(
                f'{self._checkpoint}: expected a folder without a checkpoint, or to resume'
            )
        # Episodes count from 1, so that 0 is free for the weights before the first.
        self.controller.initialise(controller_rng(seed, 0))
        self._begin_records()
        self._save()

    @property
    def start(self) -> Start:
        """The episode to reset the simulator to before the first step."""
        return self._start

    def steps_after(self, observations: int) -> int:
        """Return about how many steps there will be after so many observations more."""
        return self.steps + observations

    @property
    def observations_left(self) -> int:
        """About how many observations there are until the training is done."""
        return self._parameters.steps - self.steps

    def scalars(self) -> dict[str, float]:
        """Return what can be plotted of the last episode, under Stable-Baselines3's names."""
        return {}

    @property
    def parameters(self) -> TrainingParameters:
        """How long it takes and how often it is saved."""
        return self._parameters

    @property
    def is_done(self) -> bool:
        """Whether all steps are driven; never between two episodes."""
        return self.steps >= self._parameters.steps and not self._needs_reset

    @property
    def needs_reset(self) -> bool:
        """Whether the episode is over, so that the simulator is to be reset to the next lane."""
        return self._needs_reset

    def reset(self, rng: np.random.Generator) -> None:
        """Begin an episode, unless it is one that is being repeated to resume."""
        if not self._is_replaying:
            self._answers = array('d')
            self._n_replayed = 0
            self.controller.reset(rng)

    def step(self, observation: Observation) -> WheelVelocities:
        """Answer an observation, and save what is due.

        Raises:
            CheckpointError: The episode that is being repeated to resume is not the same.
            FileError: The checkpoint cannot be written.
        """
        lane = observation.lane
        assert lane is not None  # nobody can be trained without
        if self._is_replaying:
            return self._repeated_answer(lane)
        wheels = self.controller.step(observation)
        if self._counts(lane):
            self.steps += 1
            self._is_due |= self.steps % self._parameters.save_every == 0
        if lane.terminated:
            self.end_episode(lane)
            return wheels
        self._needs_reset = False
        self._keep(Start(lane.lane, lane.episode), lane.distance_m, wheels)
        return wheels

    def take(
        self,
        start: Start,
        distance_m: float,
        answers: NDArray[np.float64],
        taken_in: Any,
        *,
        has_ended: bool,
    ) -> None:
        """Take in what a kernel has driven since the last call.

        The controller is already as these answers have left it.

        Args:
            start: The episode.
            distance_m: Distance from the lane's centre in the last observation answered.
            answers: Velocities of the left and the right wheel [rad/s], (n, 2), at most
                `observations_to_take`; without that to the observation that ended the episode.
            taken_in: What `ControllerFleet.taken_in` returned.
            has_ended: Whether such an observation followed; then `end_episode` is to be called.

        Raises:
            SpikelaneError: The checkpoint cannot be written, or the training cannot go on.
        """
        self._needs_reset = has_ended
        if counted := self._take_in(len(answers), taken_in):
            self.steps += counted
            self._is_due |= self.steps % self._parameters.save_every == 0
        if len(answers):
            self._keep(start, distance_m, answers.ravel().tolist(), len(answers))

    def end_episode(self, lane: LaneState) -> None:
        """Note the end of an episode, whose last observation has just been answered."""
        self._needs_reset = True
        self.terminations.append(self._termination(lane))
        self._record_episode()
        self.on_episode()

    @property
    def observations_to_take(self) -> int:
        """How many observations there are until the next checkpoint, or until all is driven."""
        return self._steps_to_take

    @property
    def _steps_to_take(self) -> int:
        """The same of steps."""
        every = self._parameters.save_every
        return min(every - self.steps % every, self._parameters.steps - self.steps)

    @property
    def answers_to_repeat(self) -> NDArray[np.float64]:
        """Answers of this episode that a resumed training gives again, (n, 2) [rad/s]."""
        return np.array(self._answers).reshape(-1, 2)[self._n_replayed :]

    def end_repetition(self, lane: LaneState) -> None:
        """Note that all of `answers_to_repeat` were given again.

        Args:
            lane: What the last of them answered.

        Raises:
            CheckpointError: The episode is not the same.
        """
        self._n_replayed = len(self._answers) // 2 - 1
        self._repeated_answer(lane)

    def _keep(
        self, start: Start, distance_m: float, answers: Sequence[float], number: int = 1
    ) -> None:
        """Keep answers of an episode that goes on, and save what is due."""
        self._start, self._distance_m = start, distance_m
        self._answers.extend(answers)
        self._n_replayed += number
        if self._needs_reset:
            return  # what is due is saved when the next episode has begun
        if self._is_due:
            self._record_step()
        if self._is_due or self.is_done:
            self._save()
            self._is_due = False

    def resume(self, *, can_repeat: bool = True) -> None:
        """Go on where the checkpoint stands.

        Args:
            can_repeat: Whether the episode that was interrupted can be driven again, as in a
                simulation; otherwise the training goes on with the next one.

        Raises:
            CheckpointError: There is none that can be read, or it is of another configuration.
        """
        checkpoint = read_checkpoint(self._checkpoint, self._name)
        arrays, facts = checkpoint
        self._check_config(facts)
        try:
            self.controller.restore(controller_state(checkpoint))
            self._restore(arrays, facts)
            self._restore_records(checkpoint)
        except CheckpointError as error:
            raise CheckpointError(f'{self._checkpoint}: {error}') from None
        if not can_repeat:
            self._answers = array('d')
            self._start = Start(self._start.lane, self._start.episode + 1)

    def _restore(self, arrays: Arrays, facts: Mapping[str, Any]) -> None:
        """Become what `_save` wrote of the training itself."""
        self.steps = number(facts, 'steps', int)
        self.terminations = records(facts, 'terminations', Termination)
        self._config = mapping(facts, 'config')
        start = {'start': [[facts.get('lane'), facts.get('episode')]]}
        [self._start] = records(start, 'start', Start)
        self._distance_m = float(number(facts, 'distance_m', float))
        answers = state_array(arrays, 'training.answers', np.dtype(np.float64), (None, 2))
        self._answers = array('d', answers.ravel())
        self._n_replayed = 0

    @property
    def _is_replaying(self) -> bool:
        return 2 * self._n_replayed < len(self._answers)

    def _repeated_answer(self, lane: LaneState) -> WheelVelocities:
        """Return what was answered when this was first seen."""
        first = 2 * self._n_replayed
        is_same = (lane.episode, lane.step) == (self._start.episode, self._n_replayed)
        self._n_replayed += 1
        is_last = not self._is_replaying
        if not is_same or lane.terminated or (is_last and lane.distance_m != self._distance_m):
            raise CheckpointError(
                f'{self._checkpoint}: expected episode {self._start.episode} to be the same again,'
                f' got another by step {lane.step}: is it of another version or machine?'
            )
        return WheelVelocities(*self._answers[first : first + 2])

    def _counts(self, lane: LaneState) -> bool:
        """Return whether the step that ended with this observation counts."""
        return not lane.terminated

    def _take_in(self, answered: int, taken_in: Any) -> int:
        """Add what a kernel has driven to the records, and return how many steps count.

        Args:
            answered: Observations answered that did not end an episode.
            taken_in: What `ControllerFleet.taken_in` returned.
        """
        del taken_in
        return answered

    def _begin_records(self) -> None:
        """Begin the records that are kept in addition to the terminations."""

    def _record_step(self) -> None:
        """Add to the records, just before a checkpoint that is due."""

    def _record_episode(self) -> None:
        """Add to the records, just after a termination."""

    def _records(self) -> Checkpoint:
        """Return the records as a checkpoint is to hold them."""
        return Checkpoint({}, {})

    def _restore_records(self, checkpoint: Checkpoint) -> None:
        """Become what `_records` returned.

        Raises:
            CheckpointError: They cannot be had.
        """

    def _save(self) -> None:
        """Write the checkpoint; it is forced to the disk, and for people to read, at the end."""
        arrays, facts = state_checkpoint(self.controller.state())
        records = self._records()
        arrays['training.answers'] = np.array(self._answers).reshape(-1, 2)
        arrays |= records.arrays
        write_checkpoint(
            self._checkpoint,
            self._name,
            arrays,
            {
                'config': self._config,
                **facts,
                'steps': self.steps,
                'lane': self._start.lane,
                'episode': self._start.episode,
                'distance_m': self._distance_m,
                'terminations': [list(each) for each in self.terminations],
                **records.facts,
            },
            sync=self.is_done,
        )

    def _check_config(self, facts: Mapping[str, Any]) -> None:
        if 'terminations' not in facts:
            raise CheckpointChoiceError(
                f'{self._checkpoint}: expected a training, got weights alone'
            )
        config = current_config(mapping(facts, 'config'))
        own = config.get(self._name)
        if isinstance(own, Mapping):
            # What the checkpoint's version did not have yet was as the default is, or was.
            defaults = type(self.controller.parameters)().to_dict()
            config[self._name] = {**defaults, **self.former_values, **own}
        for name, expected in self._config.items():
            if name == INPUTS and name not in config:
                continue  # of a version that did not tell
            given = config.get(name)
            if given != expected:
                where, expected, given = first_difference(name, expected, given)
                raise CheckpointChoiceError(
                    f'{self._checkpoint}: expected a training with {where} {expected}, '
                    f'got one with {given}'
                )

    def _termination(self, lane: LaneState) -> Termination:
        return Termination(
            step=self.steps,
            episode=lane.episode,
            lane=lane.lane,
            section=lane.section,
            position_m=lane.position_m,
            distance_m=lane.distance_m,
            episode_steps=lane.step,
            reason=lane.reason,
        )


def state_checkpoint(state: SavedState) -> Checkpoint:
    """Return a controller's own state as a checkpoint holds it; see `controller_state`."""
    is_array = {name: isinstance(value, np.ndarray) for name, value in state.items()}
    return Checkpoint(
        {_PREFIX + name: value for name, value in state.items() if is_array[name]},
        {'controller': {name: value for name, value in state.items() if not is_array[name]}},
    )


def controller_state(checkpoint: Checkpoint) -> SavedState:
    """Return the controller's own state."""
    state: SavedState = {
        name.removeprefix(_PREFIX): value
        for name, value in checkpoint.arrays.items()
        if name.startswith(_PREFIX)
    }
    state.update(mapping(checkpoint.facts, 'controller'))
    return state
