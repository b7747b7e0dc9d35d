"""The card of a controller: all that the rest of the program must know of it.

A package registers a card under the controller's name, as an entry point of the group
`spikelane.controllers`. Places in a card are texts, 'module:attribute', and are imported only when
they are needed, so that nobody waits for PyTorch. Nothing outside a controller's own folder names
the controller.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple


@dataclass(frozen=True, kw_only=True)
class TrainingCard:
    """How a controller is trained by driving it.

    Attributes:
        training: Place of the class, a `learning.training.Training`.
        results: Place of the class, a `learning.results.TrainingResults`: what a training has to
            show in metrics, figures and reports.
        defaults: Parameters whose defaults are different in a training, as 'simulator.…', or
            without the controller's name where they are its own. `learning` is always true and
            `checkpoint` always empty.
        device: Name of the controller's parameter that says on which device it learns, '' for
            none.
        requires: What a training needs installed: the name of a list in `requirements/`, '' for
            nothing.
        is_usual: Whether commands train it where no controller is asked for.
    """

    training: str = 'spikelane_controllers.learning.training:Training'
    results: str = 'spikelane_controllers.learning.results:TrainingResults'
    defaults: Mapping[str, Any] = field(default_factory=dict)
    device: str = ''
    requires: str = ''
    is_usual: bool = False


@dataclass(frozen=True, kw_only=True)
class TransferCard:
    """How a controller takes over what another one has learnt.

    Attributes:
        source: Name of the controller that has learnt.
        transfer: Place of the class, a `learning.transfer.Transfer`.
        results: Place of the class, a `learning.results.Results`.
        requires: As in TrainingCard.
    """

    source: str
    transfer: str
    results: str
    requires: str = ''


class PaperValue(NamedTuple):
    """One result of the paper.

    Attributes:
        scenario: A scenario of the paper, '1' to '3'.
        measure: Name of what was measured, as in the metrics.
        value: The value in that measure's unit; None where the paper says it in words alone.
        words: The value as the report shows it.
        place: Where in the paper it stands.
    """

    scenario: str
    measure: str
    value: float | None
    words: str
    place: str


class Aim(NamedTuple):
    """What a controller is to reach in a scenario; a report says whether it does.

    Attributes:
        scenario: A scenario of the paper, '1' to '3'.
        measure: As in PaperValue.
        value: The value that is aimed at, in that measure's unit.
        setting: As the report names the setting that it is aimed at with, '' for the paper's;
            None for every setting.
        is_lowest: Whether the value is to be reached from above: at least, and not at most.
        is_of_median: Whether it is the median over trainings, and not the mean.
    """

    scenario: str
    measure: str
    value: float
    setting: str | None = None
    is_lowest: bool = False
    is_of_median: bool = False


@dataclass(frozen=True, kw_only=True)
class PaperCard:
    """What the paper (Bing et al. 2020) shows of a controller.

    Attributes:
        order: Position among the paper's controllers, from 0 on.
        laps: Scenarios in which the paper shows laps.
        learnt: Scenarios in which the paper shows how it learnt, by driving or by transfer.
        values: Results in the text, in tables and captions; errors are mostly shown as curves.
    """

    order: int
    laps: tuple[str, ...] = ()
    learnt: tuple[str, ...] = ()
    values: tuple[PaperValue, ...] = ()

    def value(self, scenario: str, measure: str) -> PaperValue | None:
        """Return what the paper says of a measure, None where it says nothing."""
        wanted = (scenario, measure)
        return next((each for each in self.values if each[:2] == wanted), None)


@dataclass(frozen=True, kw_only=True)
class ControllerCard:
    """A controller; see the module.

    Attributes:
        controller: Place of the class; see `registry.ControllerClass`.
        fleet: Place of the class, a `fleet.ControllerFleet`, that drives many robots in one
            kernel; '' where there is none.
        is_usual: Whether commands take it where no controller is asked for.
        title: Its name in figures and tables; '' for the name it is registered under.
        training: How it is trained by driving, None where it does not learn so.
        transfer: How it takes over what another one has learnt, None where it does not.
        weights: Folder of the weights shipped with it, each NAME.safetensors; None for none.
        weight_arrays: Names of the arrays in a checkpoint that it drives with.
        figures: Place of a function that returns the figures (`learning.results.Figure`) which a
            report shows of the controller itself, whatever runs there are; '' for none.
        nir_graph: Place of a function that returns it as a NIR graph; '' where there is none.
        paper: What the paper shows of it, None for nothing.
        aims: What it is to reach.
    """

    controller: str
    fleet: str = ''
    title: str = ''
    is_usual: bool = False
    training: TrainingCard | None = None
    transfer: TransferCard | None = None
    weights: Path | None = None
    weight_arrays: tuple[str, ...] = ()
    figures: str = ''
    nir_graph: str = ''
    paper: PaperCard | None = None
    aims: tuple[Aim, ...] = ()
