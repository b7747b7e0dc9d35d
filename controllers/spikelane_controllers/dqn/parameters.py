"""Parameters of the deep Q-network controller and of its learning; the paper's are the default."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

from numba.extending import register_jitable

from spikelane_controllers.dqn.q_network import MOST_WEIGHTS, QNetworkParameters
from spikelane_sim.encoding import StateImageParameters
from spikelane_sim.parameters import check_size, MOST_STEPS, nested, parameter, Parameters
from spikelane_sim.period import TimedParameters
from spikelane_sim.task import DecisionParameters

_TABLE = 'table "DQN parameters"'


class Exploration(NamedTuple):
    """How the probability of a random action falls; see `QLearningParameters`."""

    random_steps: int
    annealing_steps: int
    start: float
    end: float


@register_jitable
def exploration_rate(exploration: Exploration, steps: int) -> float:
    """Return the probability of a random action after so many steps (section 3.4)."""
    progress = (steps - exploration.random_steps) / exploration.annealing_steps
    fall = exploration.start - exploration.end
    return exploration.start - fall * min(max(progress, 0.0), 1.0)


@dataclasses.dataclass(frozen=True, kw_only=True)
class QLearningParameters(Parameters):
    """How the network learns. Steps are those of actions."""

    discount: float = parameter(0.99, 'Discount factor.', low=0.0, high=1.0, source=_TABLE)
    learning_rate: float = parameter(1e-4, "Adam's step size.", low=0.0, high=10.0, source=_TABLE)
    batch_size: int = parameter(
        32, 'Transitions in one update.', low=1, high=65_536, source=_TABLE
    )
    update_every: int = parameter(
        4, 'Action steps between two updates.', low=1, high=1_000_000, source=_TABLE
    )
    soft_update: float = parameter(
        0.001,
        'Fraction of the way that the target network moves towards the network after each update.',
        low=0.0,
        high=1.0,
        source=_TABLE,
    )
    buffer_size: int = parameter(
        5000, 'Number of transitions kept, the latest ones.', low=1, high=10_000_000, source=_TABLE
    )
    random_steps: int = parameter(
        1000,
        'Action steps before the first update; exploration stays at its start value in them.',
        low=0,
        high=MOST_STEPS,
        source=_TABLE,
    )
    annealing_steps: int = parameter(
        49_000,
        'Action steps after these over which exploration falls to its end value (99000 in the '
        "authors' program).",
        low=1,
        high=MOST_STEPS,
        source=_TABLE,
    )
    exploration_start: float = parameter(
        1.0,
        'Probability of a random action at the beginning of the training.',
        low=0.0,
        high=1.0,
        source=_TABLE,
    )
    exploration_end: float = parameter(
        0.1,
        'Probability of a random action after exploration has fallen.',
        low=0.0,
        high=1.0,
        source=_TABLE,
    )
    device: str = parameter(
        'cpu',
        'Device that computes the updates; on cuda PyTorch does, whatever the backend.',
        choices=('cpu', 'cuda'),
    )
    backend: str = parameter(
        'numba',
        'Library that computes the updates on the CPU: Numba (numba), or PyTorch (torch), which '
        'takes more time and differs by rounding.',
        choices=('numba', 'torch'),
    )

    def exploration_rate(self, steps: int) -> float:
        """Return the probability of a random action after so many steps (section 3.4)."""
        rate: float = exploration_rate(self.exploration, steps)
        return rate

    @property
    def needs_pytorch(self) -> bool:
        """Whether PyTorch computes the updates."""
        return self.backend == 'torch' or self.device != 'cpu'

    @property
    def exploration(self) -> Exploration:
        """How exploration falls."""
        return Exploration(
            self.random_steps,
            self.annealing_steps,
            self.exploration_start,
            self.exploration_end,
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class DqnParameters(TimedParameters):
    """The deep Q-network controller."""

    learning: bool = parameter(
        False, 'Explore and learn; otherwise the best action is always taken.'
    )
    checkpoint: str = parameter(
        'scenario_1',
        "Initial weights: the name of shipped ones, the path of a training's folder or of a "
        'checkpoint, or empty for untrained ones.',
    )
    averaged: bool = parameter(
        False,
        'Use the target network of a checkpoint, which is a running average of the learning '
        'network and depends less on the last updates.',
    )
    image: StateImageParameters = nested(StateImageParameters)
    task: DecisionParameters = nested(DecisionParameters)
    network: QNetworkParameters = nested(QNetworkParameters)
    q_learning: QLearningParameters = nested(QLearningParameters)

    def _check_relations(self) -> None:
        inputs = self.image.rows * self.image.columns
        network, learning = self.network, self.q_learning
        both = {'image, network.hidden_2': inputs + network.hidden_2}
        check_size('weights', {**both, 'network.hidden_1': network.hidden_1}, MOST_WEIGHTS)
        states = {'inputs (image)': inputs}
        check_size('values', {**states, 'q_learning.batch_size': learning.batch_size}, 1e8)
        check_size('values', {**states, 'q_learning.buffer_size': learning.buffer_size}, 4e9)
