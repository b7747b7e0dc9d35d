"""Where the rows of a report come from: commands, and commits, machines and versions."""

from __future__ import annotations

from collections.abc import Iterable
import json
from typing import NamedTuple

from spikelane.report.commands import command_of
from spikelane.report.groups import by_key, seeds_in_words
from spikelane.report.kinds import UNUSABLE
from spikelane.report.runs import Lap, LeftOut, Runs, TrainingRun, TransferRun
from spikelane_sim.errors import SpikelaneError

#: Stands for what a run's version did not write down.
NOT_RECORDED = 'not recorded'


class Commands(NamedTuple):
    """What made the runs of some rows.

    Attributes:
        what: Which rows these are, in words.
        lines: The commands, each once.
    """

    what: str
    lines: list[str]


class MadeWith(NamedTuple):
    """What computed some of the runs."""

    runs: int
    commit: str
    machine: str
    versions: str


def all_commands(runs: Runs) -> tuple[list[Commands], list[LeftOut]]:
    """Return the commands that made all runs, and the runs whose command is unknown."""
    commands, left_out = [], []
    kinds: dict[str, Iterable[Lap | TrainingRun | TransferRun]] = {
        'Trainings': runs.trainings,
        'Transfers': runs.transfers,
        'Laps': runs.laps,
    }
    for kind, of_kind in kinds.items():
        for key, group in by_key(of_kind).items():
            lines: dict[str, None] = {}
            for run in group:
                try:
                    lines[command_of(run)] = None
                except UNUSABLE as error:
                    why = str(error) if isinstance(error, SpikelaneError) else repr(error)
                    left_out.append(LeftOut(f'Command of {run.folder}', why))
            seeds = seeds_in_words([run.seed for run in group])
            if lines:
                commands.append(Commands(f'{kind}: {key.words}; seeds {seeds}', list(lines)))
    return commands, left_out


def made_with(runs: Runs) -> list[MadeWith]:
    """Return what computed the runs, each set once, with how many runs it did."""
    counts: dict[str, int] = {}
    for run in runs.all():
        found = run.config.get('versions')
        given = {str(k): str(v) for k, v in found.items() if v} if isinstance(found, dict) else {}
        counts[json.dumps(given)] = counts.get(json.dumps(given), 0) + 1
    return [_made_with(json.loads(text), number) for text, number in counts.items()]


def _made_with(given: dict[str, str], runs: int) -> MadeWith:
    commit, machine = (given.pop(name, NOT_RECORDED) for name in ('commit', 'machine'))
    versions = ', '.join(f'{name} {version}' for name, version in given.items())
    return MadeWith(runs, commit, machine, versions or NOT_RECORDED)
