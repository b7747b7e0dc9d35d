"""What a transfer of a policy has to show: accuracy, and how rates approach activations."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, TypedDict

from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_controllers.dqn_snn.convergence import RateError
from spikelane_controllers.dqn_snn.transfer import Measured
from spikelane_controllers.learning.results import Figure, FinishedRun, Measure
from spikelane_controllers.registry import card
from spikelane_controllers.saved_state import records
from spikelane_sim.kinds import check_kind

#: Simulated times that rates are told after: the paper's 10 ms for each step, and long [ms].
_RATE_TIMES_MS = (10, 1000)

_HEADING = 'Transfer'


class _Metrics(TypedDict):
    """What the metrics of a transfer must have."""

    accuracy: float
    training_accuracy: float
    states: int
    maximum: int
    rates: dict[str, list[RateError]]


class TransferResults:
    """What a transfer has to show; see `learning.results.Results`.

    Attributes:
        run: What was read.
        curve: Accuracy over the training of the network.
    """

    step_words: ClassVar[str] = 'a batch of states'
    note: ClassVar[str] = (
        'Accuracy: share of states with the action of the Q-network, held out or trained with. '
        'Agreement: share of states with most output spikes for the action of the network with '
        'activations, after that simulated time from rest, potentials reset to 0. Difference: '
        'between rates and activations of the output neurons, root mean square.'
    )

    def __init__(self, run: FinishedRun) -> None:
        """Read what a transfer left.

        Raises:
            CheckpointError: The checkpoint cannot be read.
            KindError: The metrics are those of something else.
        """
        self.run = run
        facts = read_checkpoint(run.folder, run.controller).facts
        self.curve = records(facts, 'curve', Measured)
        metrics = check_kind(dict(run.metrics), _Metrics, 'metrics.json')
        self._accuracy: float = metrics['accuracy']
        self._training_accuracy = metrics['training_accuracy']
        self._states = metrics['states']
        self.rates = {
            name: [RateError(**each) for each in errors]
            for name, errors in metrics['rates'].items()
        }

    def sort_key(self) -> float:
        """Return the accuracy."""
        return self._accuracy

    def measures(self) -> tuple[Measure, ...]:
        """Return what reports compare; see `note`."""
        return (
            Measure('states', 'states', 'count', self._states),
            Measure('accuracy', "accuracy on the policy's states", 'share', self._accuracy),
            Measure(
                'training_accuracy', 'accuracy: trained with', 'share', self._training_accuracy
            ),
            *(
                Measure(f'{name}_{time_ms}_ms', f'{words} after {time_ms:,} ms', unit, value)
                for name, words, unit in (
                    ('agreement', 'agreement', 'share'),
                    ('output', 'difference', 'spikes/ms'),
                )
                for time_ms in _RATE_TIMES_MS
                for value in self._after(name, time_ms)
            ),
        )

    def figures(self) -> tuple[Figure, ...]:
        """Return what can be drawn."""
        accuracy = 'Accuracy over the training of the network'
        rates = 'Firing rates against activations over the simulated time'
        return (
            Figure(_HEADING, 'accuracy', accuracy, self._draw_accuracy),
            Figure(_HEADING, 'rates', rates, self._draw_rates),
        )

    def _after(self, name: str, time_ms: int) -> list[float]:
        """Return what was measured after some simulated time, nothing where it was not."""
        errors = self.rates.get('reset to 0', ())
        return [getattr(each, name) for each in errors if each.simulated_ms == time_ms]

    def _draw_accuracy(self, path: Path, title: str) -> tuple[Path, ...]:
        from spikelane_controllers.dqn_snn.transfer_figures import draw_accuracy

        paper = card(self.run.controller).paper
        scenario = str(self.run.config['scenario']).removeprefix('scenario_')
        value = paper.value(scenario, 'accuracy') if paper else None
        return draw_accuracy(self.curve, path, title, value.value if value else None)

    def _draw_rates(self, path: Path, title: str) -> tuple[Path, ...]:
        from spikelane_controllers.dqn_snn.transfer_figures import draw_rates

        return draw_rates(self.rates, path, title)
