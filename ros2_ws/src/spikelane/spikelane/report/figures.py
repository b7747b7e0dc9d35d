"""The report's figures, each drawn anew from what runs left, and named by what it shows.

What cannot be drawn because no run has what it takes is named with the reason.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
import functools
import math
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

from spikelane.figures import style
from spikelane.figures.past import PlasticPast
from spikelane.interruption import check
from spikelane.report.comparisons import (
    Comparison,
    comparisons,
    median_run,
    Place,
    representative_laps,
)
from spikelane.report.groups import by_key, PAPER_LANE, seeds_in_words
from spikelane.report.kinds import UNUSABLE
from spikelane.report.labels import (
    bar_label,
    file_name,
    label_of,
    title_of,
    words_of,
)
from spikelane.report.missing import missing
from spikelane.report.paper import paper_value
from spikelane.report.runs import (
    Conditions,
    course_of,
    Lap,
    LeftOut,
    Runs,
    TrainingRun,
    TransferRun,
)
from spikelane.report.training_times import first_lap, stable
from spikelane.trajectory import read_csv, Trajectory
from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_controllers.states import read_states
from spikelane_controllers.weights import WEIGHTS
from spikelane_sim.encoding import EncodingParameters, StateImageParameters
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.files import WriteError


class Drawn(NamedTuple):
    """A figure that is drawn.

    Attributes:
        heading: Heading of the part of the page it belongs to.
        caption: What it shows, of which run.
        files: Its files; the smallest is shown.
    """

    heading: str
    caption: str
    files: tuple[Path, ...]


#: Shows what is being drawn.
Show = Callable[[str], None]


class Figures(NamedTuple):
    """What came of drawing.

    Attributes:
        drawn: The figures in the order of the page.
        left_out: What could not be drawn, and why.
        unwritten: Names of the figures that could not be written, with the errors.
    """

    drawn: list[Drawn]
    left_out: list[LeftOut]
    unwritten: dict[str, WriteError]


def draw_figures(runs: Runs, folder: Path, show: Show) -> Figures:
    """Draw all figures that these runs have something for.

    Args:
        runs: To draw.
        folder: Folder of the files.
        show: Told what is being drawn.
    """
    drawn: list[Drawn] = []
    left_out: list[LeftOut] = []
    unwritten: dict[str, WriteError] = {}
    for each in _all(runs, folder):
        show(each.name)
        check()
        try:
            drawn.append(Drawn(each.heading, each.caption, each.draw()))
        except SpikelaneError as error:
            left_out.append(LeftOut(each.caption, str(error)))
            if isinstance(error, WriteError):
                unwritten[each.name] = error
        except KeyError as error:
            left_out.append(LeftOut(each.caption, f'a run of another version, without {error}'))
        except UNUSABLE as error:
            # A file of one run is damaged: it must not cost the report of all others.
            left_out.append(LeftOut(each.caption, f'a run with values of a wrong kind: {error}'))
    return Figures(drawn, left_out + list(missing(runs)), unwritten)


class _Figure(NamedTuple):
    """A figure to be drawn."""

    heading: str
    name: str  # of its files
    caption: str
    draw: Callable[[], tuple[Path, ...]]


def _all(runs: Runs, folder: Path) -> Iterator[_Figure]:
    """Yield the figures in the paper's order."""
    yield from _of_the_task(folder)
    chosen = representative_laps(runs.laps)
    yield from _of_a_lap(chosen, folder)
    yield from _of_trainings(runs.trainings, folder)
    yield from _of_transfers(runs.transfers, folder)
    yield from _braitenberg(folder)
    for comparison in comparisons(chosen):
        yield _compared(comparison, chosen, runs.laps, folder)
    if runs.trainings:
        yield _training_time(runs.trainings, folder)
    for number, conditions in enumerate(runs.conditions):
        yield _robustness(conditions, number, folder)


def _of_the_task(folder: Path) -> Iterator[_Figure]:
    from spikelane.figures.rewards import draw_rewards
    from spikelane.figures.scenarios import draw_scenarios

    caption = 'The course and its three scenarios'
    yield _Figure(
        'Task', 'scenarios', caption, lambda: draw_scenarios(folder / 'scenarios', 'The course')
    )
    caption = 'Rewards over the distance from the lane centre'
    yield _Figure('Task', 'rewards', caption, lambda: draw_rewards(folder / 'rewards', 'Rewards'))


def _of_a_lap(chosen: Mapping[Place, Lap], folder: Path) -> Iterator[_Figure]:
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

    yield _Figure('A lap', 'animation', f'Camera events beside the course: {words}', draw_moving)
    yield _Figure('Task', 'state_input', f'State input, half way: {words}', draw_state)


def _of_trainings(trainings: Sequence[TrainingRun], folder: Path) -> Iterator[_Figure]:
    from spikelane.figures.episodes import draw_episodes
    from spikelane.figures.state_images import draw_state_images
    from spikelane.figures.terminations import draw_terminations
    from spikelane.figures.weights import draw_weights

    for key, group in by_key(trainings).items():
        run = median_run(group, _settled_by)
        stem = f'{key.controller}_{file_name(key)}'
        words = f'{key.words}: seed {run.seed}, the median of {len(group)}'
        if key.controller == 'dqn':

            def draw(run: TrainingRun = run, stem: str = stem) -> tuple[Path, ...]:
                lanes = tuple(course_of(run).lanes)
                return draw_episodes(run, lanes, folder / f'{stem}_training', title_of(run))

            def draw_states(run: TrainingRun = run, stem: str = stem) -> tuple[Path, ...]:
                states = read_states(run.folder)
                if not len(states):
                    raise SpikelaneError(f'{run.folder}: expected states met, got none')
                return draw_state_images(states, folder / f'{stem}_states', title_of(run))

            heading = 'DQN training'
            yield _Figure(heading, f'{stem}_training', f'Episodes and rewards, {words}', draw)
            yield _Figure(heading, f'{stem}_states', f'States met, {words}', draw_states)
        elif key.controller == 'rstdp':

            def draw_learnt(run: TrainingRun = run, stem: str = stem) -> tuple[Path, ...]:
                file = folder / f'{stem}_weights'
                return draw_weights(_learnt(run), _encoding(run), file, title_of(run))

            def draw_ends(run: TrainingRun = run, stem: str = stem) -> tuple[Path, ...]:
                file = folder / f'{stem}_terminations'
                return draw_terminations(run, course_of(run), file, title_of(run))

            heading = 'R-STDP training'
            yield _Figure(heading, f'{stem}_weights', f'Learnt weights, {words}', draw_learnt)
            yield _Figure(heading, f'{stem}_terminations', f'Terminations, {words}', draw_ends)


def _braitenberg(folder: Path) -> Iterator[_Figure]:
    from spikelane.figures.weights import draw_fixed_weights
    from spikelane_controllers.braitenberg import braitenberg_weights, BraitenbergParameters

    def draw() -> tuple[Path, ...]:
        weights_pa = braitenberg_weights(BraitenbergParameters())
        file = folder / 'braitenberg_weights'
        return draw_fixed_weights(weights_pa, EncodingParameters(), file, 'Braitenberg weights')

    caption = (
        'Weights of the Braitenberg controller, of which by default only those of the lowest row '
        'have an effect'
    )
    yield _Figure('Braitenberg controller', 'braitenberg_weights', caption, draw)


def _of_transfers(transfers: Sequence[TransferRun], folder: Path) -> Iterator[_Figure]:
    """Yield how the network learnt, and how its rates approach the activations."""
    from spikelane.figures.transfer import draw_accuracy, draw_rates

    for key, group in by_key(transfers).items():
        run = median_run(group, lambda each: float(each.metrics['accuracy']))
        stem = f'transfer_{file_name(key)}'
        words = f'{key.words}: seed {run.seed}, the median of {len(group)}'

        def draw_curve(run: TransferRun = run, stem: str = stem) -> tuple[Path, ...]:
            paper = paper_value('dqn_snn', run.scenario, 'accuracy')
            return draw_accuracy(
                run.curve, folder / f'{stem}_accuracy', title_of(run), paper and paper.value
            )

        def draw_convergence(run: TransferRun = run, stem: str = stem) -> tuple[Path, ...]:
            return draw_rates(run.rates, folder / f'{stem}_rates', title_of(run))

        caption = f'Accuracy over the training of the network, {words}'
        yield _Figure('Transfer', f'{stem}_accuracy', caption, draw_curve)
        caption = f'Firing rates against activations over the simulated time, {words}'
        yield _Figure('Transfer', f'{stem}_rates', caption, draw_convergence)


def _compared(
    comparison: Comparison, chosen: Mapping[Place, Lap], laps: Sequence[Lap], folder: Path
) -> _Figure:
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
    return _Figure('Laps', comparison.name, caption, draw)


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


def _robustness(conditions: Conditions, number: int, folder: Path) -> _Figure:
    from spikelane.figures.robustness import draw_robustness

    title = str(conditions.results.get('name', 'Robustness')).capitalize()
    name = 'robustness' if number == 0 else f'robustness_{number + 1}'
    return _Figure(
        'Robustness',
        name,
        f'Error and share of laps completed under difficulties: {conditions.folder}',
        lambda: draw_robustness(conditions.results, folder / name, title),
    )


def _settled_by(run: TrainingRun) -> float:
    """Return the last lane loss; of trainings that have not settled it is later than of others."""
    return float(run.last_lane_loss_step) if run.has_settled else math.inf


def first_lap_of(lap: Lap) -> Trajectory:
    """Return the first lap of a drive, or all of it where there is none."""
    from spikelane.report.again import first_lap

    return first_lap(_trajectory(lap))


def _training_time(trainings: Sequence[TrainingRun], folder: Path) -> _Figure:
    from spikelane.figures.training_time import draw_training_time, TrainingTimes

    def draw() -> tuple[Path, ...]:
        groups = {
            bar_label(key): TrainingTimes(
                [first_lap(run) for run in group],
                [stable(run) for run in group],
                style.RIGHT if key.controller == 'rstdp' else style.LEFT,
            )
            for key, group in by_key(trainings).items()
        }
        return draw_training_time(groups, folder / 'training_time', 'Training time')

    caption = (
        'Training time: simulated steps to the first lap and to stable driving, Kaplan-Meier '
        'medians over all trainings'
    )
    return _Figure('Training time', 'training_time', caption, draw)


def _learnt(run: TrainingRun) -> PlasticPast:
    """Return a training of R-STDP with the weights in its checkpoint."""
    arrays = read_checkpoint(run.folder, run.controller).arrays
    return SimpleNamespace(
        steps=run.steps,
        terminations=run.terminations,
        weights_pa=arrays[WEIGHTS],
        weight_history=list(arrays['training.weight_history']),
        # A checkpoint's own configuration has it without the training's length.
        save_every=run.config.get('training', run.config)['save_every'],
    )


def _trajectory(lap: Lap) -> Trajectory:
    return read_csv(lap.folder / 'trajectory.csv')


def _encoding(run: TrainingRun) -> EncodingParameters:
    values = {
        name.removeprefix('encoding.'): value
        for name, value in run.config[run.controller].items()
        if name.startswith('encoding.')
    }
    return EncodingParameters.from_mapping(values, 'encoding')
