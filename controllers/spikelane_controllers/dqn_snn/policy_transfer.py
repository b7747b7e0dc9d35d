"""The transfer of a deep Q-network's policy to a spiking network (paper section 3.5).

States are gathered and labelled with the policy's actions, a network is trained with them and
normalised, and its firing rates are compared with the activations that they stand for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses
from pathlib import Path
import tempfile
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_controllers.dqn.controller import Dqn
from spikelane_controllers.dqn.parameters import DqnParameters
from spikelane_controllers.dqn.pytorch import require_pytorch
from spikelane_controllers.dqn.q_network import action_values, MOST_WEIGHTS
from spikelane_controllers.dqn.training import visited_episodes
from spikelane_controllers.dqn.visited_states import NAME, read_states
from spikelane_controllers.dqn_snn.controller import DqnSnn, DqnSnnParameters, FrameParameters
from spikelane_controllers.dqn_snn.convergence import rate_errors, RateError
from spikelane_controllers.dqn_snn.integrate_and_fire import IntegrateAndFireParameters
from spikelane_controllers.dqn_snn.normalisation import normalise, Normalised
from spikelane_controllers.dqn_snn.transfer import (
    class_shares,
    Labelled,
    learn_policy,
    Learnt,
    scaled,
    TransferParameters,
)
from spikelane_controllers.dqn_snn.transferred import Transferred, write_transferred
from spikelane_controllers.learning.gathering import (
    gather_states,
    Gathered,
    GatheringParameters,
)
from spikelane_controllers.learning.transfer import OnStageProgress, STATES, TransferRequest
from spikelane_controllers.saved_state import mapping
from spikelane_controllers.weights import find_checkpoint
from spikelane_sim.contract import Controller
from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import check_size, Parameters
from spikelane_sim.simulator import Simulator
from spikelane_sim.task import ACTIONS

_TRAINING_STEPS = 'training steps'
_RATE_DURATIONS_MS = (10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0)
_RATE_STATES = 50
_ROUNDS_APART = 1_000_000  # seeds between those of two rounds
_RESETS = {'reset to 0': 'zero', 'less the threshold': 'subtract'}


class PolicyTransfer:
    """A transfer of a Q-network's policy; see `learning.transfer.Transfer`."""

    parameters_classes: ClassVar[Mapping[str, type[Parameters]]] = {
        'gathering': GatheringParameters,
        'transfer': TransferParameters,
    }
    #: As in training (paper section 3.4).
    defaults: ClassVar[Mapping[str, Any]] = {
        'simulator.episode.max_laps': 0,
        'simulator.episode.max_steps': 10_000,
    }

    _learnt: Learnt
    _normalised: Normalised
    _states: dict[str, int]  # number of states, by where they are from
    _shares: list[float]  # of each action among the labels

    def __init__(self, request: TransferRequest) -> None:
        """Prepare the transfer.

        Raises:
            ParameterError: The network or its batches would be too large, or the spiking network
                cannot drive with the control period.
        """
        self._request = request
        gathering, transfer = (request.parameters[name] for name in self.parameters_classes)
        assert isinstance(gathering, GatheringParameters)
        assert isinstance(transfer, TransferParameters)
        self._gathering, self._transfer = gathering, transfer
        inputs = {
            'inputs (gathering.encoding)': gathering.encoding.rows * gathering.encoding.columns
        }
        check_size('weights', {**inputs, 'transfer.hidden': transfer.hidden}, MOST_WEIGHTS)
        check_size('values', {**inputs, 'transfer.batch_size': transfer.batch_size}, 1e8)
        if transfer.rounds:
            try:
                self._driving()
            except ParameterError as error:
                raise ParameterError(f'transfer.driving: {error}') from None

    @staticmethod
    def has_states(checkpoint: Path) -> bool:
        """Return whether the states visited in a training are there, next to its checkpoint."""
        return _states_file(checkpoint).exists()

    def check(self) -> None:
        """Make sure that there is what learns, and from whom.

        Raises:
            SpikelaneError: PyTorch is not there, or the policy cannot be read.
        """
        require_pytorch()
        self._policy()

    def run(self, show: OnStageProgress) -> None:
        """Gather states, label them, train a network with them and normalise it.

        Raises:
            SpikelaneError: The policy or its states cannot be read, or not learnt from.
        """
        require_pytorch()  # before anything is driven
        policy = self._policy()
        parts = self._visited()
        rounds = self._transfer.rounds
        for number in range(rounds + 1):
            driver, name = (self._spiking(), f'round {number}') if number else (policy, 'gathered')
            show_round = _show_of_round(show, number, rounds)
            parts[name] = self._gathered(driver, number, show_round)
            self._learn(policy, parts, show_round)

    def save(self, path: Path, config: Mapping[str, Any]) -> None:
        """Write both networks.

        Raises:
            FileError: They cannot be written.
        """
        learnt = self._learnt
        facts = {
            'config': dict(config),
            'normalisation': self._transfer.normalisation,
            'accuracy': learnt.curve[-1].held_out,
            'states': self._states,
            'curve': [list(each) for each in learnt.curve],
        }
        transferred = Transferred(self._normalised.network, learnt.scale)
        write_transferred(path, learnt.network, transferred, facts)

    def metrics(self) -> dict[str, Any]:
        """Return what was measured."""
        learnt = self._learnt
        return {
            'states': sum(self._states.values()),
            'states_from': self._states,
            'held_out_states': len(learnt.held_out.actions),
            'class_shares': dict(zip(ACTIONS, self._shares, strict=True)),
            'accuracy': learnt.curve[-1].held_out,
            'training_accuracy': learnt.curve[-1].training,
            'maximum': learnt.scale.maximum,
            'normalisation': self._transfer.normalisation,
            'hidden_divisor': self._normalised.hidden_divisor,
            'output_divisor': self._normalised.output_divisor,
            'rates': {
                name: [each._asdict() for each in errors] for name, errors in self._rates().items()
            },
        }

    def _visited(self) -> dict[str, Gathered]:
        """Return the states met in the training, if they are to be used."""
        request = self._request
        if not request.from_training:
            return {}
        checkpoint = find_checkpoint(request.source, request.checkpoint)
        states = read_states(_states_file(checkpoint))
        counts = states.reshape(len(states), -1)
        return {'training': Gathered(counts, visited_episodes(checkpoint, len(counts)))}

    def _gathered(self, driver: Controller, number: int, show: OnStageProgress) -> Gathered:
        """Return states met where a controller drives, in each round with another seed."""
        seed = self._request.seed + _ROUNDS_APART * number
        with Simulator(self._request.simulator) as simulator:
            return gather_states(
                simulator,
                driver,
                self._gathering,
                seed,
                lambda done, of: show(STATES, done, of),
                self._request.filter,
            )

    def _learn(self, policy: Dqn, parts: Mapping[str, Gathered], show: OnStageProgress) -> None:
        """Label states with the policy's actions, train a network with them, and normalise it."""
        counts = np.vstack([each.counts for each in parts.values()])
        values = action_values(policy.network, (counts > 0).astype(np.uint8))
        actions = values.argmax(axis=1).astype(np.int64)
        labelled = Labelled(counts, actions, _numbered(list(parts.values())), values)
        self._learnt = learn_policy(
            labelled,
            len(ACTIONS),
            self._gathering.encoding.frames,
            self._transfer,
            # 0 to 2: simulator, controller, gathering.
            np.random.default_rng([self._request.seed, 3]),
            lambda done, of: show(_TRAINING_STEPS, done, of),
            self._gathering.encoding.frame_ms,
        )
        self._normalised = normalise(self._learnt.network, self._normalising_inputs())
        self._states = {name: len(each.counts) for name, each in parts.items()}
        self._shares = class_shares(labelled.actions, len(ACTIONS))

    def _spiking(self) -> DqnSnn:
        """Return the controller of the network as it is, which sees as many steps as a state."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / 'checkpoint.safetensors'
            self.save(path, {})
            return DqnSnn(dataclasses.replace(self._driving(), checkpoint=str(path)))

    def _driving(self) -> DqnSnnParameters:
        """Return the parameters that the spiking network drives with in rounds.

        Raises:
            ParameterError: It cannot, with the control period of the simulator.
        """
        driving = self._transfer.driving
        return DqnSnnParameters(
            encoding=FrameParameters.from_mapping(self._gathering.encoding.to_dict()),
            period_ms=self._request.simulator.period_ms,
            trace_decay=driving.trace_decay,
            neurons=driving.neurons,
        )

    def _policy(self) -> Dqn:
        """Return the Q-network that acts greedily, of the size it was trained in."""
        source, checkpoint = self._request.source, self._request.checkpoint
        facts = read_checkpoint(find_checkpoint(source, checkpoint), source).facts
        values = mapping(mapping(facts, 'config'), source)
        values |= {'learning': False, 'checkpoint': checkpoint, 'q_learning.device': 'cpu'}
        parameters = DqnParameters.from_mapping(values, checkpoint)
        if parameters.image != self._gathering.encoding:
            raise ParameterError(
                f'gathering.encoding: expected that of the Q-network, '
                f'{parameters.image.to_dict()}, got {self._gathering.encoding.to_dict()}'
            )
        return Dqn(parameters)

    def _normalising_inputs(self) -> NDArray[np.float32] | None:
        """Return the inputs to normalise by, None where the weights alone decide."""
        if self._transfer.normalisation == 'model':
            return None
        return scaled(self._learnt.held_out.counts, self._learnt.scale.maximum)

    def _rates(self) -> dict[str, list[RateError]]:
        """Compare rates with activations on some states held out, for either reset."""
        counts = self._learnt.held_out.counts[:_RATE_STATES]
        values = scaled(counts, self._learnt.scale.maximum)
        return {
            name: rate_errors(
                self._normalised.network,
                values,
                _RATE_DURATIONS_MS,
                IntegrateAndFireParameters(reset=reset),
                np.random.default_rng([self._request.seed, 4]),
            )
            for name, reset in _RESETS.items()
        }


def _show_of_round(show: OnStageProgress, number: int, rounds: int) -> OnStageProgress:
    """Return what shows the progress of a round, after so many of all."""
    return lambda what, done, of: show(what, number * of + done, (rounds + 1) * of)


def _numbered(parts: Sequence[Gathered]) -> NDArray[np.int64]:
    """Return numbers of episodes, (n,), no two parts having the same."""
    numbers, used = [], 0
    for each in parts:
        numbers.append(each.episodes + used)
        used += int(each.episodes.max()) + 1
    return np.concatenate(numbers)


def _states_file(checkpoint: Path) -> Path:
    """Return where the states of a training are."""
    return (checkpoint if checkpoint.is_dir() else checkpoint.parent) / NAME
