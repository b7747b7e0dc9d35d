"""Names of settings: each tells runs apart that differ, and none is as long as a paragraph."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import dataclasses
import itertools
from pathlib import Path
from typing import Any

from spikelane.report.runs import NamedSetting, ReportedRun, Runs

#: Letters up to which a setting is its own name.
LONGEST = 40


def name_settings(runs: Runs) -> None:
    """Give all long settings names, and keep in `runs.settings` what these stand for.

    Args:
        runs: All, each with its setting in words.
    """
    kinds: dict[str, list[Any]] = {
        'trainings': runs.trainings,
        'transfers': runs.transfers,
        'laps': runs.laps,
    }
    for kind, found in kinds.items():
        _tell_trainings_apart(found)
        names = _names(found, runs.variants)
        found[:] = [dataclasses.replace(run, setting=names[_key(run)]) for run in found]
        runs.settings.extend(
            NamedSetting(controller, kind, name, words)
            for (controller, words), name in names.items()
            if name != words
        )


def _tell_trainings_apart(runs: list[Any]) -> None:
    """Add the length of the training to settings that differ only in it.

    How long is usual depends on the scenario: where all are as long it says nothing.
    """
    lengths: dict[tuple[str, str, str], set[int | None]] = {}
    for run in runs:
        place = run.controller, run.scenario, run.setting
        lengths.setdefault(place, set()).add(run.learnt_steps)
    for index, run in enumerate(runs):
        if len(lengths[run.controller, run.scenario, run.setting]) > 1:
            steps = 'unknown' if run.learnt_steps is None else f'{run.learnt_steps:,}'
            parts = [*filter(None, [run.setting]), f'trained for {steps} steps']
            runs[index] = dataclasses.replace(run, setting='; '.join(parts))


def _names(
    runs: Sequence[ReportedRun], variants: Mapping[Path, str]
) -> dict[tuple[str, str], str]:
    """Return the names of settings by controller and words; no two of a controller's are alike."""
    names = {_key(run): run.setting for run in runs if len(run.setting) <= LONGEST}
    for run in runs:
        if _key(run) not in names:
            taken = {
                name for (controller, _), name in names.items() if controller == run.controller
            }
            names[_key(run)] = next(
                name for name in _candidates(run, variants) if name not in taken
            )
    return names


def _key(run: ReportedRun) -> tuple[str, str]:
    return run.controller, run.setting


def _candidates(run: ReportedRun, variants: Mapping[Path, str]) -> Iterator[str]:
    """Yield the name that a run's experiment has for its setting, and numbered ones."""
    # A lap of an evaluation is in a folder of the evaluation's.
    folders = (run.folder, *run.folder.parents)
    variant = next(filter(None, map(variants.get, folders)), None)
    if variant:
        yield variant
    for number in itertools.count(2 if variant else 1):
        yield f'{variant or "setting"} {number}'
