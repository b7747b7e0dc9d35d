"""Runs that are laid together, what they are called, and the form of the report's tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
import re
from typing import Any, NamedTuple, TypeVar

from spikelane_controllers.registry import position, title

#: Columns that say of which group of runs a row is.
PLACE = ('controller', 'scenario', 'setting')

#: What a table calls the setting that is the paper's.
PAPERS_SETTING = "the paper's"

#: The lane on which the paper compares controllers.
PAPER_LANE = 'outer'


class Table(NamedTuple):
    """A table of texts.

    Attributes:
        title: Above it.
        note: Below it, '' for none.
        header: Names of the columns.
        rows: The cells.
        brief: Names of the columns that a reader needs first, but for those of a run's group
            (controller, scenario, setting). Empty: a reader needs none of it first.
    """

    title: str
    note: str
    header: tuple[str, ...]
    rows: list[tuple[str, ...]]
    brief: tuple[str, ...] = ()


class Key(NamedTuple):
    """What runs that differ in nothing but the seed have in common."""

    controller: str
    scenario: str
    setting: str

    @property
    def shown_setting(self) -> str:
        """The setting as a table shows it."""
        return self.setting or PAPERS_SETTING

    @property
    def words(self) -> str:
        """All of it in words."""
        setting = f' ({self.setting})' if self.setting else ''
        return f'{title(self.controller)}, scenario {self.scenario}{setting}'


def _place(key: Key) -> tuple[str, tuple[int, str], list[tuple[float, str]]]:
    """Return what groups are sorted by; numbers in a setting by their value."""
    parts = re.split(r'(\d+(?:\.\d+)?)', key.setting)
    setting = [(float(part), '') if part[:1].isdigit() else (-1.0, part) for part in parts]
    return key.scenario, position(key.controller), setting


R = TypeVar('R', bound=Any)


def by_key(runs: Iterable[R]) -> dict[Key, list[R]]:
    """Group runs that differ in nothing but the seed; scenario by scenario, the paper's order."""
    groups: dict[Key, list[R]] = {}
    for run in runs:
        groups.setdefault(Key(run.controller, run.scenario, run.setting), []).append(run)
    return {
        key: sorted(groups[key], key=lambda run: run.seed) for key in sorted(groups, key=_place)
    }


def place_in_words(cells: Mapping[str, str]) -> str:
    """Return of which group a row is, in words.

    Args:
        cells: The row's cells, by their columns; those of PLACE are among them.
    """
    controller, scenario, setting = (cells[name] for name in PLACE)
    words = f'{controller}, scenario {scenario}'
    return words if setting == PAPERS_SETTING else f'{words} ({setting})'


def seeds_in_words(seeds: Sequence[int]) -> str:
    """Return seeds in order, those in a row as a range: '0 to 2, 7'."""
    ordered = sorted(set(seeds))
    runs: list[list[int]] = []
    for seed in ordered:
        if runs and seed == runs[-1][-1] + 1:
            runs[-1].append(seed)
        else:
            runs.append([seed])
    return ', '.join(str(run[0]) if len(run) == 1 else f'{run[0]} to {run[-1]}' for run in runs)
