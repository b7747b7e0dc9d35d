"""What a training of R-STDP has to show: its weights, also compared with the Braitenberg ones."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.learning.results import Figure, Measure, TrainingResults
from spikelane_controllers.rstdp.learnt_weights import WEIGHTS
from spikelane_controllers.spiking.weights_by_hand import weights_correlation
from spikelane_sim.encoding import EncodingParameters


class PlasticResults(TrainingResults):
    """What a training of few weights has to show; see `training.PlasticTraining`."""

    @property
    def weights_pa(self) -> NDArray[np.float64]:
        """Weights at the end [pA], (n_neurons, n_inputs)."""
        return self.arrays()[WEIGHTS]

    @property
    def weight_history(self) -> list[NDArray[np.float32]]:
        """Weights every `save_every` steps, from step 0, each (n_neurons, n_inputs)."""
        return list(self.arrays()['training.weight_history'])

    @property
    def save_every(self) -> int:
        """Steps between the weights of the history."""
        config = self.run.config
        # A checkpoint's own configuration has it without the training's length.
        return int(config.get('training', config)['save_every'])

    @property
    def _encoding(self) -> EncodingParameters:
        """How its inputs are made."""
        values = {
            name.removeprefix('encoding.'): value
            for name, value in self.run.config[self.run.controller].items()
            if name.startswith('encoding.')
        }
        return EncodingParameters.from_mapping(values, 'encoding')

    def metrics(self) -> dict[str, Any]:
        """Measure the training.

        Returns:
            As `TrainingResults.metrics`, and `braitenberg_correlation`: how like the weights set
            by hand the learnt ones are, None where the inputs are others.
        """
        is_alike = self._encoding == EncodingParameters()
        correlation = (
            weights_correlation(self.weights_pa, self.weight_history[0]) if is_alike else None
        )
        return {**super().metrics(), 'braitenberg_correlation': correlation}

    def measures(self) -> tuple[Measure, ...]:
        """Return what reports compare; the correlation where the run's metrics have it."""
        found = self.run.metrics.get('braitenberg_correlation')
        overall = found.get('overall') if isinstance(found, Mapping) else None
        if not isinstance(overall, float):
            return super().measures()
        words = 'correlation with the Braitenberg weights'
        measure = Measure('braitenberg_correlation', words, 'correlation', overall)
        return (*super().measures(), measure)

    def figures(self) -> tuple[Figure, ...]:
        """Return what can be drawn."""
        weights = Figure(self._heading, 'weights', 'Learnt weights', self._draw_weights)
        return (weights, *super().figures())

    def _draw_weights(self, path: Path, title: str) -> tuple[Path, ...]:
        from spikelane_controllers.spiking.weights_figure import draw_weights

        words = ''
        if self._encoding == EncodingParameters():
            correlation = weights_correlation(self.weights_pa)['overall']
            if correlation is not None:
                words = f'correlation with the Braitenberg weights {correlation:.2f}'
        return draw_weights(self, self._encoding, path, title, words)
