"""Transferring a policy to a spiking network: what determines it, doing it, and what it leaves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane.configuration import check_seed, parameter_groups
from spikelane.interruption import check
from spikelane.run_folder import RunFolder
from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_controllers.convergence import rate_errors, RateError
from spikelane_controllers.dqn import Dqn
from spikelane_controllers.dqn_parameters import DqnParameters
from spikelane_controllers.gathering import gather_states, GatheringParameters
from spikelane_controllers.integrate_and_fire import IntegrateAndFireParameters
from spikelane_controllers.normalisation import normalise, Normalised
from spikelane_controllers.pytorch import require_pytorch
from spikelane_controllers.q_network import action_values, MOST_WEIGHTS
from spikelane_controllers.state import mapping
from spikelane_controllers.states import NAME, read_states
from spikelane_controllers.transfer import (
    class_shares,
    Labelled,
    learn_policy,
    Learnt,
    scaled,
    TransferParameters,
)
from spikelane_controllers.transferred import Transferred, write_transferred
from spikelane_controllers.weights import find_checkpoint, shipped_weights
from spikelane_sim.course import course_label, scenario_course
from spikelane_sim.encoding import Counts
from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import check_size
from spikelane_sim.simulator import Simulator, SimulatorParameters
from spikelane_sim.task import ACTIONS

#: What gathering states differs in from driving a lap: as in training (paper section 3.4).
GATHERING_DEFAULTS = {'simulator.episode.max_laps': 0, 'simulator.episode.max_steps': 10_000}

#: Accuracy on the states (paper section 5.2), by scenario.
PAPER_ACCURACY = {'scenario_1': 0.9305, 'scenario_2': 0.9171}

#: What is being done, in turn: states gathered, steps of training done.
STATES, TRAINING_STEPS = 'states', 'training steps'

#: Shows what is being done, how much of it is, and of how much.
Show = Callable[[str, int, int], None]

_RATE_DURATIONS_MS = (10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0)
_RATE_STATES = 50
_RESETS = {'reset to 0': 'zero', 'less the threshold': 'subtract'}


@dataclasses.dataclass(frozen=True, kw_only=True)
class TransferConfig:
    """Everything that determines a transfer.

    Attributes:
        scenario: Where states are gathered; see `Configuration`.
        checkpoint: Whose policy: the name of shipped weights of the DQN, the path of a training's
            folder or of a checkpoint.
        seed: Seed of all randomness.
        simulator: Where states are gathered.
        gathering: How.
        transfer: How the network is trained with them.
        from_training: Whether the states of the DQN's training are used too.
    """

    scenario: str
    checkpoint: str
    seed: int
    simulator: SimulatorParameters
    gathering: GatheringParameters
    transfer: TransferParameters
    from_training: bool

    @property
    def usual_name(self) -> str:
        """As in `run_folder.Run`."""
        return f'transfer-{course_label(self.scenario)}-seed{self.seed}'

    def check(self) -> None:
        """Make sure that there is what learns, and from whom.

        Raises:
            SpikelaneError: PyTorch is not there, or the policy cannot be read.
        """
        require_pytorch()
        _policy(self)

    def to_dict(self) -> dict[str, Any]:
        """Return all of it under names, ready for YAML."""
        return {
            field.name: value.to_dict() if hasattr(value, 'to_dict') else value
            for field in dataclasses.fields(self)
            for value in (getattr(self, field.name),)
        }


class PolicyTransfer(NamedTuple):
    """What came of a transfer."""

    learnt: Learnt
    normalised: Normalised
    states: dict[str, int]  # by where they are from
    shares: list[float]  # of each action among the labels


def make_config(
    scenario: str,
    checkpoint: str | None,
    seed: int,
    parameters: Mapping[str, Any],
    from_training: bool | None,
) -> TransferConfig:
    """Make the configuration of a transfer.

    Args:
        scenario: '1' to '3' of the paper, or the name or path of another course.
        checkpoint: As in TransferConfig; None for the weights shipped for the scenario.
        seed: Seed of all randomness.
        parameters: Others than the defaults, as `simulator.camera.fov_deg`, `gathering.states`
            and `transfer.steps`.
        from_training: As in TransferConfig; None for where there are any.

    Raises:
        SpikelaneError: Anything is unknown or not allowed, or there is no such checkpoint.
    """
    if checkpoint is None:
        checkpoint = scenario_course(scenario)
    elif checkpoint not in shipped_weights('dqn'):
        checkpoint = str(Path(checkpoint).absolute())
    is_there = _states_file(find_checkpoint('dqn', checkpoint)).exists()
    if from_training and not is_there:
        raise ParameterError(
            f'--from-training: expected {NAME} beside the checkpoint, got none: {checkpoint}'
        )
    is_wanted = is_there if from_training is None else from_training
    return configure_transfer(scenario, checkpoint, seed, parameters, is_wanted)


def configure_transfer(
    scenario: str, checkpoint: str, seed: int, parameters: Mapping[str, Any], from_training: bool
) -> TransferConfig:
    """Make the configuration of a transfer as it will be, whether its checkpoint is there or not.

    Args:
        scenario: As in `make_config`.
        checkpoint: Taken as it is.
        seed: As in `make_config`.
        parameters: As in `make_config`.
        from_training: As in TransferConfig.

    Raises:
        SpikelaneError: Anything is unknown or not allowed.
    """
    groups = parameter_groups(
        GATHERING_DEFAULTS | dict(parameters),
        {'simulator': {'course': scenario_course(scenario)}, 'gathering': {}, 'transfer': {}},
    )
    check_seed(seed)
    config = TransferConfig(
        scenario=scenario,
        checkpoint=checkpoint,
        seed=seed,
        simulator=SimulatorParameters.from_mapping(groups['simulator'], 'simulator'),
        gathering=GatheringParameters.from_mapping(groups['gathering'], 'gathering'),
        transfer=TransferParameters.from_mapping(groups['transfer'], 'transfer'),
        from_training=from_training,
    )
    encoding, transfer = config.gathering.encoding, config.transfer
    inputs = {'inputs (gathering.encoding)': encoding.rows * encoding.columns}
    check_size('weights', {**inputs, 'transfer.hidden': transfer.hidden}, MOST_WEIGHTS)
    check_size('values', {**inputs, 'transfer.batch_size': transfer.batch_size}, 1e8)
    return config


def transfer(config: TransferConfig, show: Show) -> PolicyTransfer:
    """Gather states, label them, train a network with them and normalise it.

    Args:
        config: What to do.
        show: Told about what goes on.

    Raises:
        SpikelaneError: The policy or its states cannot be read, or not learnt from.
        Interrupted: A signal has come; nothing is kept.
    """
    require_pytorch()  # before anything is driven

    def show_and_check(what: str, done: int, of: int) -> None:
        show(what, done, of)
        check()

    policy = _policy(config)
    file = find_checkpoint('dqn', config.checkpoint)
    parts: dict[str, NDArray[np.uint8]] = {}
    if config.from_training:
        trained = read_states(_states_file(file))
        parts['training'] = trained.reshape(len(trained), -1)
    with Simulator(config.simulator) as simulator:
        parts['gathered'] = gather_states(
            simulator,
            lambda counts: _action(policy, counts),
            config.gathering,
            config.seed,
            lambda done, of: show_and_check(STATES, done, of),
        )
    counts = np.vstack(list(parts.values()))
    actions = action_values(policy.network, (counts > 0).astype(np.uint8)).argmax(axis=1)
    labelled = Labelled(counts, actions.astype(np.int64))
    learnt = learn_policy(
        labelled,
        len(ACTIONS),
        config.gathering.encoding.frames,
        config.transfer,
        np.random.default_rng([config.seed, 3]),  # 0 to 2: simulator, controller, gathering
        lambda done, of: show_and_check(TRAINING_STEPS, done, of),
    )
    return PolicyTransfer(
        learnt,
        normalise(learnt.network, _data(config, learnt)),
        {name: len(states) for name, states in parts.items()},
        class_shares(labelled.actions, len(ACTIONS)),
    )


def report_transfer(
    config: TransferConfig, done: PolicyTransfer, folder: RunFolder
) -> dict[str, Any]:
    """Write the networks, metrics and figures of a transfer.

    Returns:
        The metrics and where everything is, ready for JSON.
    """
    from spikelane.figures.transfer import draw_accuracy, draw_rates

    learnt, normalised = done.learnt, done.normalised
    course = scenario_course(config.scenario)
    paper = PAPER_ACCURACY.get(course)
    rates = _rates(config, done)
    name = f'scenario {config.scenario}, seed {config.seed}'
    result = {
        'scenario': config.scenario,
        'seed': config.seed,
        'source': config.checkpoint,
        'robot': config.simulator.robot.model,
        'pixels': config.simulator.pixels.model,
        'antialias': config.simulator.camera.antialias,
        'states': sum(done.states.values()),
        'states_from': done.states,
        'held_out_states': len(learnt.held_out.actions),
        'class_shares': dict(zip(ACTIONS, done.shares, strict=True)),
        'accuracy': learnt.curve[-1].held_out,
        'training_accuracy': learnt.curve[-1].training,
        'paper_accuracy': paper,
        'maximum': learnt.scale.maximum,
        'normalisation': config.transfer.normalisation,
        'hidden_divisor': normalised.hidden_divisor,
        'output_divisor': normalised.output_divisor,
        'rates': {name: [each._asdict() for each in errors] for name, errors in rates.items()},
        'folder': str(folder.path),
        'checkpoint': str(folder.checkpoint),
    }
    facts = {
        'config': config.to_dict(),
        'normalisation': config.transfer.normalisation,
        'accuracy': result['accuracy'],
        'states': done.states,
        'curve': [list(each) for each in learnt.curve],
    }
    transferred = Transferred(normalised.network, learnt.scale)
    # Before the figures: whatever becomes of these, what was learnt is kept.
    write_transferred(folder.checkpoint, learnt.network, transferred, facts)
    figures = [
        *draw_accuracy(learnt.curve, folder.figures / 'accuracy', f'Accuracy, {name}', paper),
        *draw_rates(rates, folder.figures / 'rates', f'Rates, {name}'),
    ]
    result['figures'] = [str(figure) for figure in figures]
    folder.write_metrics(result)
    return result


def _policy(config: TransferConfig) -> Dqn:
    """Return the DQN that acts greedily, of the size it was trained in."""
    facts = read_checkpoint(find_checkpoint('dqn', config.checkpoint), 'dqn').facts
    values = mapping(mapping(facts, 'config'), 'dqn')
    values |= {'learning': False, 'checkpoint': config.checkpoint, 'q_learning.device': 'cpu'}
    parameters = DqnParameters.from_mapping(values, str(config.checkpoint))
    if parameters.image != config.gathering.encoding:
        raise ParameterError(
            f'gathering.encoding: expected that of the Q-network, {parameters.image.to_dict()}, '
            f'got {config.gathering.encoding.to_dict()}'
        )
    return Dqn(parameters)


def _action(policy: Dqn, counts: Counts) -> int:
    state = (counts > 0).astype(np.uint8).reshape(1, -1)
    return int(action_values(policy.network, state)[0].argmax())


def _data(config: TransferConfig, learnt: Learnt) -> NDArray[np.float32] | None:
    """Return the inputs to normalise by, None where the weights alone decide."""
    if config.transfer.normalisation == 'model':
        return None
    return scaled(learnt.held_out.counts, learnt.scale.maximum)


def _states_file(checkpoint: Path) -> Path:
    """Return where the states of a training are."""
    return (checkpoint if checkpoint.is_dir() else checkpoint.parent) / NAME


def _rates(config: TransferConfig, done: PolicyTransfer) -> dict[str, list[RateError]]:
    """Compare rates with activations on some states held out, for either reset."""
    counts = done.learnt.held_out.counts[:_RATE_STATES]
    values = scaled(counts, done.learnt.scale.maximum)
    return {
        name: rate_errors(
            done.normalised.network,
            values,
            _RATE_DURATIONS_MS,
            IntegrateAndFireParameters(reset=reset),
            np.random.default_rng([config.seed, 4]),
        )
        for name, reset in _RESETS.items()
    }
