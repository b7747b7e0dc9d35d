"""Evaluating a controller: laps of every lane with several seeds, and how they went on the whole.

Each lap is the one that `spikelane lap` drives with the same lane and seed. Laps that are done are
kept one by one, so that an evaluation that was stopped goes on with the next, and its results are
those of one that never was: nothing in `metrics.json` depends on when or where it was made.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
import shutil
from typing import Any

from spikelane.runs.evaluate.config import EvaluateConfig, LapOfEvaluation
from spikelane.runs.evaluate.metrics import evaluation_metrics
from spikelane.runs.evaluate.summary import check_lap, SummarisedLap
from spikelane.runs.folder import RunFolder
from spikelane.runs.lap.metrics import lap_metrics
from spikelane.runs.lap.run import drive
from spikelane.runs.lap.trajectory import read_csv, Trajectory, write_csv
from spikelane.runs.output import OnProgress, ShowShare
from spikelane_controllers.operations import Operations
from spikelane_controllers.registry import title as controller_title
from spikelane_sim.contract import STEP_S
from spikelane_sim.course import course_label, load_course, scenario_course
from spikelane_sim.files import write_json


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
    # A lap that was interrupted restarts.
    shutil.rmtree(path, ignore_errors=True)
    RunFolder.create(path, numbered=False)
    driven = drive(each.config, folder, show, record=record)
    trajectory = driven.trajectory
    write_csv(trajectory, folder.trajectory)
    row = {
        'course': each.config.scenario,
        'lane': each.config.lane,
        'seed': each.config.seed,
        **lap_metrics(trajectory, STEP_S),
        'progress_m': float(trajectory.progress_m[-1] - trajectory.progress_m[0]),
        'operations': None if driven.operations is None else driven.operations._asdict(),
    }
    write_json(folder.metrics, row)
    return row
