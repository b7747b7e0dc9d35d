"""What runs are called in the report: in titles, beside bars, and as names of files."""

from __future__ import annotations

from collections.abc import Sequence
import textwrap
import zlib

from spikelane.report.collect import Lap, TrainingRun, TransferRun
from spikelane.report.tables import Key, shown_name

#: Letters of a setting that there is room for.
ROW_LETTERS, _BAR_LETTERS, _BAR_LINES, _FILE_LETTERS = 100, 44, 2, 60


def title_of(run: Lap | TrainingRun | TransferRun) -> str:
    """Return what a figure of a run is called."""
    return f'{shown_name(run.controller)}, scenario {run.scenario}, seed {run.seed}'


def words_of(lap: Lap) -> str:
    """Return what drove, where and how, in words."""
    return Key(lap.controller, lap.scenario, lap.setting).words


def label_of(lap: Lap) -> str:
    """Return what drove, in words that fit above its row of a figure."""
    name = shown_name(lap.controller)
    return f'{name} ({cut(lap.setting, ROW_LETTERS)})' if lap.setting else name


def short_label(key: Key) -> str:
    """Return a group in words that fit beside its bar in a figure."""
    name = f'{shown_name(key.controller)}, scenario {key.scenario}'
    return '\n'.join([name, *_wrapped(key.setting)])


def _wrapped(setting: str) -> list[str]:
    """Return a setting in the lines that there is room for beside a bar."""
    lines = textwrap.wrap(setting, _BAR_LETTERS)
    if len(lines) <= _BAR_LINES:
        return lines
    return [*lines[: _BAR_LINES - 1], cut(' '.join(lines[_BAR_LINES - 1 :]), _BAR_LETTERS)]


def cut(text: str, letters: int) -> str:
    """Return a text, shortened to so many letters."""
    return text if len(text) <= letters else text[: letters - 4] + ' ...'


def distinct(labels: Sequence[str]) -> list[str]:
    """Return labels with a number where the same came before."""
    return [
        label if (before := labels[:index].count(label)) == 0 else f'{label} ({before + 1})'
        for index, label in enumerate(labels)
    ]


def file_name(key: Key) -> str:
    """Return a name for the files of a group, that no other group has."""
    name = f'scenario_{plain(key.scenario)}'
    setting = plain(key.setting)
    if len(setting) > _FILE_LETTERS:  # what is cut off stays part of the name
        setting = f'{setting[:_FILE_LETTERS]}_{zlib.crc32(setting.encode()):08x}'
    return f'{name}_{setting}' if setting else name


def plain(text: str) -> str:
    """Return a text as part of a file's name."""
    return '_'.join(''.join(c if c.isalnum() else ' ' for c in text).split())
