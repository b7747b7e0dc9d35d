"""The report's figures, each drawn from the files of runs, and named by what it shows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
import functools
from pathlib import Path
from typing import NamedTuple

from spikelane.experiment.sweeps import swept_parameters
from spikelane.report.comparisons import (
    Comparison,
    comparisons,
    median_run,
    Place,
    representative_laps,
)
from spikelane.report.groups import by_key, PAPER_LANE, seeds_in_words
from spikelane.report.labels import (
    bar_label,
    file_name,
    label_of,
    title_of,
    words_of,
)
from spikelane.report.runs import (
    Conditions,
    course_of,
    Lap,
    Runs,
    TrainingRun,
    TransferRun,
)
from spikelane.runs.lap.trajectory import read_csv, Trajectory
from spikelane_controllers.learning.results import Figure
from spikelane_controllers.registry import cards, hook, title
from spikelane_sim import figure_style as style
from spikelane_sim.encoding import StateImageParameters


class ReportFigure(NamedTuple):
    """A figure to be drawn.

    Attributes:
        heading: Heading of the part of the page it belongs to.
        name: Name of its files.
        caption: What it shows, of which run.
        draw: Draws it, and returns its files.
    """

    heading: str
    name: str
    caption: str
    draw: Callable[[], tuple[Path, ...]]


def all_figures(runs: Runs, folder: Path) -> Iterator[ReportFigure]:
    """Yield the figures that these runs have something for, in the paper's order.

    Args:
        runs: To draw.
        folder: Folder of the files.
    """
    yield from _of_the_task(folder)
    chosen = representative_laps(runs.laps)
    yield from _of_a_lap(chosen, folder)
    yield from _of_results(runs.trainings, folder)
    yield from _of_results(runs.transfers, folder)
    yield from _of_controllers(folder)
    for comparison in comparisons(chosen):
        yield _compared(comparison, chosen, runs.laps, folder)
    if runs.trainings:
        yield _training_time(runs.trainings, folder)
    for number, conditions in enumerate(runs.conditions):
        yield _robustness(conditions, number, folder)
    for number, swept in enumerate(runs.swept):
        for parameter in swept_parameters(swept.results):
            yield _sweep(swept, parameter, number, folder)


def _of_the_task(folder: Path) -> Iterator[ReportFigure]:
    from spikelane.figures.scenarios import draw_scenarios

    caption = 'The course and its three scenarios'
    yield ReportFigure(
        'Task', 'scenarios', caption, lambda: draw_scenarios(folder / 'scenarios', 'The course')
    )


def _of_controllers(folder: Path) -> Iterator[ReportFigure]:
    """Yield what is drawn of controllers themselves, whatever runs there are."""
    for name, found in cards().items():
        if found.figures:
            for figure in hook(name, found.figures)():
                yield _drawn_by(figure, folder / figure.name, '', title(name))


def _drawn_by(figure: Figure, path: Path, words: str, name: str) -> ReportFigure:
    """Return a controller's figure as one of the report's.

    Args:
        figure: The controller's.
        path: Path of its files, without an ending.
        words: Behind the caption, '' for none.
        name: Title in the figure.
    """
    caption = f'{figure.caption}, {words}' if words else figure.caption
    return ReportFigure(figure.heading, path.name, caption, lambda: figure.draw(path, name))


def _of_a_lap(chosen: Mapping[Place, Lap], folder: Path) -> Iterator[ReportFigure]:
    """Yield what is drawn of one lap with what its camera saw, in the first scenario there is."""
    from spikelane.figures.animation import draw_animation
    from spikelane.figures.state_input import draw_state_input
    from spikelane.report.again import drive_again, Seen

    best = [lap for lap in chosen.values() if lap.metrics['completed']] or [*chosen.values()]
    if not best:
        return
    best = [lap for lap in best if lap.scenario == best[0].scenario]
    best = [lap for lap in best if lap.lane == PAPER_LANE] or best
    best = [lap for lap in best if not lap.setting] or best  # the paper's
    lap = best[-1]  # of the last controller in the paper's order
    words = f'{words_of(lap)}, {lap.lane} lane, seed {lap.seed}'

    @functools.cache  # both figures are of the same drive
    def seen() -> Seen:
        return drive_again(lap, _trajectory(lap))

    def draw_moving() -> tuple[Path, ...]:
        file = folder / 'animation.webp'
        return (draw_animation(*seen(), course_of(lap), file, title_of(lap)),)

    def draw_state() -> tuple[Path, ...]:
        _, events, image_size = seen()
        last = max(StateImageParameters().frames, len(events) // 2)
        file = folder / 'state_input'
        return draw_state_input(events[:last], image_size, file, 'State input')

    yield ReportFigure(
        'A lap', 'animation', f'Camera events next to the course: {words}', draw_moving
    )
    yield ReportFigure('Task', 'state_input', f'State input, half way: {words}', draw_state)


def _of_results(runs: Sequence[TrainingRun | TransferRun], folder: Path) -> Iterator[ReportFigure]:
    """Yield what runs that learn have to show: of each group, the one in the middle."""
    for key, group in by_key(runs).items():
        run = median_run(group, lambda each: float(each.results.sort_key()))
        kind = 'transfer' if isinstance(run, TransferRun) else key.controller
        words = f'{key.words}: seed {run.seed}, the median of {len(group)}'
        for figure in run.results.figures():
            path = folder / f'{kind}_{file_name(key)}_{figure.name}'
            yield _drawn_by(figure, path, words, title_of(run))


def _compared(
    comparison: Comparison, chosen: Mapping[Place, Lap], laps: Sequence[Lap], folder: Path
) -> ReportFigure:
    from spikelane.figures.comparison import draw_comparison

    scenario, lane, number, of, keys = comparison
    shown = [chosen[Place(key, lane)] for key in keys]

    def draw() -> tuple[Path, ...]:
        drives = {label_of(lap): first_lap_of(lap) for lap in shown}
        title = f'Scenario {scenario}, {lane} lane'
        return draw_comparison(drives, course_of(shown[0]), folder / comparison.name, title)

    part = f', {number} of {of}' if of > 1 else ''
    seeds = '; '.join(
        _which(lap, [each for each in laps if Place.of(each) == Place(key, lane)])
        for key, lap in zip(keys, shown, strict=True)
    )
    caption = f'Deviation over the first lap, scenario {scenario}, {lane} lane{part}. {seeds}'
    return ReportFigure('Laps', comparison.name, caption, draw)


def _which(lap: Lap, group: Sequence[Lap]) -> str:
    """Say which drive of a group is shown, and which are not."""
    words = f'{label_of(lap)}: seed {lap.seed}'
    others = [each for each in group if each is not lap]
    if not others:
        return f'{words}, the only one'
    done = sum(bool(each.metrics['completed']) for each in group)
    of = 'all' if done == len(group) else f'the {done} of {len(group)}'
    of = f'{of} that completed it' if done else f'all {len(group)}, of which none completed it'
    seeds = seeds_in_words([each.seed for each in others])
    return f'{words}, of median error of {of}; not shown: {len(others)} of seeds {seeds}'


def _robustness(conditions: Conditions, number: int, folder: Path) -> ReportFigure:
    from spikelane.figures.robustness import draw_robustness

    title = str(conditions.results.get('name', 'Robustness')).capitalize()
    name = 'robustness' if number == 0 else f'robustness_{number + 1}'
    return ReportFigure(
        'Robustness',
        name,
        f'Error and share of laps completed under difficulties: {conditions.folder}',
        lambda: draw_robustness(conditions.results, folder / name, title),
    )


def _sweep(swept: Conditions, parameter: str, number: int, folder: Path) -> ReportFigure:
    from spikelane.figures.sweep import draw_sweep

    name = f'sweep_{number + 1}_{parameter}'.replace('.', '_')
    heading = str(swept.results.get('name', 'Sweep')).replace('_', ' ').capitalize()
    return ReportFigure(
        'Sweeps',
        name,
        f'What {parameter} changes: {swept.folder}',
        lambda: draw_sweep(swept.results, parameter, folder / name, heading),
    )


def first_lap_of(lap: Lap) -> Trajectory:
    """Return the first lap of a drive, or all of it where there is none."""
    from spikelane.report.again import first_lap

    return first_lap(_trajectory(lap))


def _training_time(trainings: Sequence[TrainingRun], folder: Path) -> ReportFigure:
    from spikelane.figures.training_time import draw_training_time, TrainingTimes

    groups = by_key(trainings)
    names = list(dict.fromkeys(key.controller for key in groups))

    def draw() -> tuple[Path, ...]:
        times = {
            bar_label(key): TrainingTimes(
                [run.results.first_lap() for run in group],
                [run.results.stable() for run in group],
                style.SERIES[names.index(key.controller) % len(style.SERIES)],
            )
            for key, group in groups.items()
        }
        words = 'the first three full episodes in a row begin'
        return draw_training_time(times, folder / 'training_time', 'Training time', words)

    caption = (
        'Training time: simulated steps to the first lap and to stable driving, Kaplan-Meier '
        'medians over all trainings'
    )
    return ReportFigure('Training time', 'training_time', caption, draw)


def _trajectory(lap: Lap) -> Trajectory:
    return read_csv(lap.folder / 'trajectory.csv')
