"""What the commands of all kinds of runs have in common."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
import contextlib

from spikelane.lock import locked
from spikelane.runs.configuration import RunConfig
from spikelane.runs.folder import RunFolder, RUNS
from spikelane.runs.output import OnProgress, progress


@contextlib.contextmanager
def run_folder(
    options: argparse.Namespace, config: RunConfig, unit: str = 'm'
) -> Iterator[tuple[RunFolder, OnProgress]]:
    """Give the folder of a run, new or to be resumed, and a function that shows progress.

    Args:
        options: `out`, `json` and `command_line`; `resume` where the command has it.
        config: What determines the run.
        unit: Unit in which progress is shown.

    Raises:
        SpikelaneError: The run cannot be started or resumed.
    """
    if getattr(options, 'resume', False):
        folder = RunFolder(options.out or RUNS / config.usual_name)
        config.check_resumable(folder)
    else:
        folder = RunFolder.begin(config, options.out, options.command_line)
    with locked(folder.path), progress(options.json, unit) as show:
        yield folder, show
