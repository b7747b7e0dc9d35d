"""Transferring what a controller has learnt to another one, and what that leaves."""

from __future__ import annotations

from typing import Any

from spikelane.interruption import check
from spikelane.runs.configuration import simulator_facts
from spikelane.runs.folder import RunFolder
from spikelane.runs.transfer.config import TransferConfig
from spikelane_controllers.learning.results import FinishedRun
from spikelane_controllers.learning.transfer import OnStageProgress, Transfer
from spikelane_controllers.registry import (
    card,
    title,
    transfer_results,
)


def transfer(config: TransferConfig, show: OnStageProgress) -> Transfer:
    """Do a transfer in this process.

    Args:
        config: What to do.
        show: Is called with the progress.

    Raises:
        SpikelaneError: What was learnt or its states cannot be read, or not learnt from.
        Interrupted: A signal has come; nothing is kept.
    """

    def show_and_check(what: str, done: int, of: int) -> None:
        show(what, done, of)
        check()

    made = config.make_transfer()
    made.run(show_and_check)
    return made


def report_transfer(config: TransferConfig, done: Transfer, folder: RunFolder) -> dict[str, Any]:
    """Write the checkpoint, metrics and figures of a transfer.

    Returns:
        The metrics and where everything is, ready for JSON.
    """
    # Before the figures: whatever becomes of these, what was learnt is kept.
    done.save(folder.checkpoint, config.to_dict())
    measured = done.metrics()
    run = FinishedRun(config.controller, folder.path, config.to_dict(), measured)
    name = f'{title(config.controller)}, scenario {config.scenario}, seed {config.seed}'
    figures = [
        file
        for figure in transfer_results(config.controller)(run).figures()
        for file in figure.draw(folder.figures / figure.name, name)
    ]
    paper = card(config.controller).paper
    accuracy = (
        paper.value(config.scenario.removeprefix('scenario_'), 'accuracy') if paper else None
    )
    result = {
        'controller': config.controller,
        'scenario': config.scenario,
        'seed': config.seed,
        'source': config.checkpoint,
        **simulator_facts(config.simulator),
        **measured,
        'paper_accuracy': accuracy.value if accuracy else None,
        'folder': str(folder.path),
        'checkpoint': str(folder.checkpoint),
        'figures': [str(figure) for figure in figures],
    }
    folder.write_metrics(result)
    return result
