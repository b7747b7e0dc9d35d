"""What runs are called in the report: in titles, next to bars, and as names of files."""

from __future__ import annotations

import textwrap

from spikelane.report.groups import Key
from spikelane.report.runs import Lap, TrainingRun, TransferRun
from spikelane_controllers.registry import title

#: Number of letters that fit next to a bar.
_BAR_LETTERS = 44


def title_of(run: Lap | TrainingRun | TransferRun) -> str:
    """Return what a figure of a run is called."""
    return f'{title(run.controller)}, scenario {run.scenario}, seed {run.seed}'


def words_of(lap: Lap) -> str:
    """Return what drove, where and how, in words."""
    return Key(lap.controller, lap.scenario, lap.setting).words


def label_of(lap: Lap) -> str:
    """Return what drove, and how, where the scenario is known."""
    name = title(lap.controller)
    return f'{name} ({lap.setting})' if lap.setting else name


def bar_label(key: Key) -> str:
    """Return a group in lines that fit next to its bar in a figure."""
    name = f'{title(key.controller)}, scenario {key.scenario}'
    return '\n'.join([name, *textwrap.wrap(key.setting, _BAR_LETTERS)])


def file_name(key: Key) -> str:
    """Return a name for the files of a group."""
    name = f'scenario_{plain(key.scenario)}'
    return f'{name}_{plain(key.setting)}' if key.setting else name


def plain(text: str) -> str:
    """Return a text as part of a file's name."""
    return '_'.join(''.join(c if c.isalnum() else ' ' for c in text).split())
