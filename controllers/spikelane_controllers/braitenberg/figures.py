"""The figure of the weights set by hand."""

from __future__ import annotations

from pathlib import Path

from spikelane_controllers.braitenberg.controller import (
    braitenberg_weights,
    BraitenbergParameters,
)
from spikelane_controllers.learning.results import Figure
from spikelane_sim.encoding import EncodingParameters


def figures() -> tuple[Figure, ...]:
    """Return what a report shows of the controller itself."""
    caption = (
        'Weights of the Braitenberg controller, of which by default only those of the lowest row '
        'have an effect'
    )
    return (Figure('Braitenberg controller', 'braitenberg_weights', caption, _draw),)


def _draw(path: Path, title: str) -> tuple[Path, ...]:
    from spikelane_controllers.spiking.weights_figure import draw_fixed_weights

    weights_pa = braitenberg_weights(BraitenbergParameters())
    return draw_fixed_weights(weights_pa, EncodingParameters(), path, 'Braitenberg weights')
