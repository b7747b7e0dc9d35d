"""Evaluating a controller: laps of every lane with several seeds, and how they went on the whole.

Each lap is the one that `spikelane lap` drives with the same lane and seed. Laps that are done are
kept one by one, so that an evaluation that was stopped goes on with the next, and its results are
those of one that never was: nothing in `metrics.json` depends on when or where it was made. Laps
that a fleet can drive are driven many at a time (`fleet.laps`), where they are many, with the same
bits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import contextlib
import json
from pathlib import Path
import shutil
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane.fleet import setting as fleet_setting
from spikelane.fleet.fleet import OnAdvance
from spikelane.fleet.laps import can_drive, drive_fleet
from spikelane.fleet.setting import most_together, setting
from spikelane.interruption import check
from spikelane.runs.evaluate.config import EvaluateConfig, LapOfEvaluation
from spikelane.runs.evaluate.metrics import evaluation_metrics
from spikelane.runs.evaluate.summary import check_lap, SummarisedLap
from spikelane.runs.folder import RunFolder
from spikelane.runs.lap.metrics import lap_metrics
from spikelane.runs.lap.run import drive, DrivenLap
from spikelane.runs.lap.trajectory import read_csv, Trajectory, write_csv
from spikelane.runs.output import OnProgress, ShowShare
from spikelane_controllers.operations import Operations
from spikelane_controllers.registry import title as controller_title
from spikelane_sim.course import course_label, load_course, scenario_course
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.files import write_json

#: Duration of a lap of the paper's courses at the speed of the paper's controllers [s].
_LAP_S = 250.0


class Evaluation(NamedTuple):
    """An evaluation in its folder.

    Attributes:
        config: What to drive.
        folder: Where laps go.
        show: Called as laps come on.
    """

    config: EvaluateConfig
    folder: RunFolder
    show: ShowShare


class _Lap(NamedTuple):
    """A lap that is still to be driven."""

    each: LapOfEvaluation
    path: Path
    evaluation: int  # which one it is of


class LapRow(SummarisedLap):
    """What is used of the metrics of an evaluation's lap."""

    steps: int
    operations: Operations | None


def evaluate(
    config: EvaluateConfig, folder: RunFolder, show: ShowShare, record: Sequence[str] = ()
) -> dict[str, Any]:
    """Drive the laps that are not in the folder yet, and write the metrics of all.

    Args:
        config: What to drive.
        folder: Where laps and metrics go.
        show: Called after every step, over ROS about once a second.
        record: Quantities that the controller is to record in each lap that is driven now.

    Returns:
        The metrics, ready for JSON.

    Raises:
        SpikelaneError: A lap cannot be driven, or a file not be written.
    """
    laps = list(config.laps())
    if not record and _most_steps(config, len(laps)) >= fleet_setting.LEAST_STEPS:
        drive_together([Evaluation(config, folder, show)])
    rows: list[dict[str, Any]] = []
    steps = 0
    for number, each in enumerate(laps):
        expected_m = each.length_m * max(1, config.simulator.episode.max_laps)

        def show_lap(
            step: int,
            progress_m: float,
            done: int = number,
            steps: int = steps,
            expected_m: float = expected_m,
        ) -> None:
            share = min(max(progress_m / expected_m, 0.0), 1.0)
            show(steps + step, (done + share) / len(laps))

        rows.append(_row_of(each, folder.laps / each.name, show_lap, record))
        steps += rows[-1]['steps']
        show(steps, (number + 1) / len(laps))
    metrics = evaluation_metrics(config, rows)
    folder.write_metrics(metrics)
    return metrics


def _most_steps(config: EvaluateConfig, laps: int) -> int:
    """Return about how many steps so many laps have, or at most that many."""
    episode = config.simulator.episode
    steps = round(_LAP_S / config.simulator.period_s) * max(1, episode.max_laps)
    return laps * (min(steps, episode.max_steps) if episode.max_steps else steps)


def drive_together(evaluations: Sequence[Evaluation]) -> None:
    """Drive the laps of evaluations that a fleet has, many at a time; the others are left.

    Raises:
        SpikelaneError: A lap cannot be driven, or a file not be written.
    """
    together: dict[str, list[_Lap]] = {}
    shown = _Shown(evaluations)
    for number, (config, folder, _) in enumerate(evaluations):
        for each in config.laps():
            path = folder.laps / each.name
            if can_drive(each.config) and not RunFolder(path).metrics.exists():
                key = json.dumps(setting(each.config), sort_keys=True)
                together.setdefault(key, []).append(_Lap(each, path, number))
    for laps in together.values():
        most = most_together(laps[0].each.config)
        for first in range(0, len(laps), most):
            _drive_some(laps[first : first + most], shown)


def evaluate_together(
    evaluations: Sequence[Evaluation], fail: Callable[[RunFolder, SpikelaneError], None]
) -> None:
    """Evaluate as `evaluate` does of each, with the laps of all driven together.

    Args:
        evaluations: What to drive.
        fail: Called with the folder of an evaluation that fails, while the others go on.

    Raises:
        Interrupted: A signal has come; laps that are done are kept.
    """
    steps = sum(_most_steps(each.config, len(list(each.config.laps()))) for each in evaluations)
    if steps >= fleet_setting.LEAST_STEPS:
        # What is wrong with one is met again below, where it is known whose fault it is.
        with contextlib.suppress(SpikelaneError):
            drive_together(evaluations)
    for each in evaluations:
        check()
        try:
            evaluate(*each)
        except SpikelaneError as error:
            fail(each.folder, error)


def _drive_some(laps: Sequence[_Lap], shown: _Shown) -> None:
    """Drive laps of one setting, all at once."""
    configs = [lap.each.config for lap in laps]
    for lap, driven in zip(laps, drive_fleet(configs, shown.of(laps)), strict=True):
        check()
        _write_row(lap.each, _begin_lap(lap.path), driven)


class _Shown:
    """Shows how evaluations come on whose laps are driven together."""

    def __init__(self, evaluations: Sequence[Evaluation]) -> None:
        self._evaluations = evaluations
        self._n_laps = [len(list(each.config.laps())) for each in evaluations]
        self._steps = [0] * len(evaluations)  # of the laps that were driven before
        self._shares = [0.0] * len(evaluations)

    def of(self, laps: Sequence[_Lap]) -> OnAdvance:
        """Return what is called as these laps come on."""
        lengths_m = [
            lap.each.length_m * max(1, lap.each.config.simulator.episode.max_laps) for lap in laps
        ]
        before_steps, before_shares = list(self._steps), list(self._shares)

        def on_advance(steps: NDArray[np.int64], progress_m: NDArray[np.float64]) -> None:
            self._steps, self._shares = list(before_steps), list(before_shares)
            columns = (laps, steps.tolist(), progress_m.tolist(), lengths_m)
            for lap, step, driven_m, length_m in zip(*columns, strict=True):
                share = min(max(driven_m / length_m, 0.0), 1.0)
                self._steps[lap.evaluation] += step
                self._shares[lap.evaluation] += share / self._n_laps[lap.evaluation]
            for number in {lap.evaluation for lap in laps}:
                self._evaluations[number].show(self._steps[number], self._shares[number])

        return on_advance


def draw_some_courses(
    config: EvaluateConfig, folder: RunFolder, metrics: Mapping[str, Any]
) -> Path:
    """Draw the first courses of an evaluation, on each the laps of the first seed.

    Args:
        config: What was driven.
        folder: Where its laps are, and the figure goes.
        metrics: What `evaluate` returned.

    Returns:
        The figure.

    Raises:
        SpikelaneError: A lap cannot be read, or the figure not be written.
    """
    from spikelane.runs.evaluate.figure import draw_courses, DrivenCourse, MOST

    drives: dict[str, list[tuple[Trajectory, Mapping[str, Any]]]] = {}
    for each, row in zip(config.laps(), metrics['laps'], strict=True):
        course = each.config.scenario
        if each.config.seed == config.seed and (course in drives or len(drives) < MOST):
            trajectory = read_csv(RunFolder(folder.laps / each.name).trajectory)
            drives.setdefault(course, []).append((trajectory, row))
    driven = [
        DrivenCourse(course_label(name), load_course(scenario_course(name)), found)
        for name, found in drives.items()
    ]
    completed = metrics['summary']['courses_completed']
    title = f'{controller_title(config.controller)}, {len(driven)} of {completed["n"]} courses'
    result = f'all laps completed on {completed["successes"]} of {completed["n"]}'
    figure, *_ = draw_courses(driven, folder.figures / 'courses', title, result)
    return figure


def _row_of(
    each: LapOfEvaluation, path: Path, show: OnProgress, record: Sequence[str]
) -> dict[str, Any]:
    """Drive a lap, or read what is left of it."""
    folder = RunFolder(path)
    if folder.metrics.exists():
        return folder.read_metrics(LapRow, check_lap)
    folder = _begin_lap(path)
    return _write_row(each, folder, drive(each.config, folder, show, record=record))


def _begin_lap(path: Path) -> RunFolder:
    """Make the folder of a lap; one that was interrupted restarts."""
    shutil.rmtree(path, ignore_errors=True)
    return RunFolder.create(path, numbered=False)


def _write_row(each: LapOfEvaluation, folder: RunFolder, driven: DrivenLap) -> dict[str, Any]:
    """Write what came of a lap; return its metrics."""
    trajectory = driven.trajectory
    write_csv(trajectory, folder.trajectory)
    row = {
        'course': each.config.scenario,
        'lane': each.config.lane,
        'seed': each.config.seed,
        **lap_metrics(trajectory, each.config.simulator.period_s),
        'progress_m': float(trajectory.progress_m[-1] - trajectory.progress_m[0]),
        'operations': None if driven.operations is None else driven.operations._asdict(),
    }
    if driven.notes:
        row['notes'] = list(driven.notes)
    write_json(folder.metrics, row)
    return row
