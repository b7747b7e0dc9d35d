"""The report's figures, each drawn anew from what runs left, and named by what it shows.

What cannot be drawn because no run has what it takes is named with the reason.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
import functools
import math
from pathlib import Path
import textwrap
from types import SimpleNamespace
from typing import Any, NamedTuple
import zlib

from spikelane.figures import style
from spikelane.figures.past import PlasticPast
from spikelane.report.collect import (
    Conditions,
    Lap,
    LeftOut,
    RANDOM_COURSES,
    Runs,
    TrainingRun,
    TransferRun,
)
from spikelane.report.paper import paper_value
from spikelane.report.tables import by_key, Key, ORDER, PAPER_LANE, seeds_in_words, shown_name
from spikelane.trajectory import read_csv, Trajectory
from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_controllers.states import read_states
from spikelane_controllers.weights import WEIGHTS
from spikelane_sim.contract import STEP_S, TERMINATED_LAPS_COMPLETE
from spikelane_sim.course import Course, load_course, scenario_course
from spikelane_sim.encoding import EncodingParameters, StateImageParameters
from spikelane_sim.errors import SpikelaneError

#: Drives in one comparison; more do not fit on a screen together.
_MOST_DRIVES = 4

#: Comparisons for a scenario and lane; an experiment can have dozens of settings.
_MOST_COMPARISONS = 3

#: Other courses than the paper's that are compared on.
_MOST_OTHER_COURSES = 3

PAPER_SCENARIOS = ('1', '2', '3')

#: Letters of a setting that there is room for.
_ROW_LETTERS, _BAR_LETTERS, _BAR_LINES, _FILE_LETTERS = 100, 44, 2, 60


class Drawn(NamedTuple):
    """A figure that is drawn.

    Attributes:
        heading: Of the part of the page it belongs to.
        caption: What it shows, of which run.
        files: Its files; the first that is small enough is shown.
    """

    heading: str
    caption: str
    files: tuple[Path, ...]


#: Shows what is being drawn.
Show = Callable[[str], None]


def draw_figures(runs: Runs, folder: Path, show: Show) -> tuple[list[Drawn], list[LeftOut]]:
    """Draw all figures that these runs have something for.

    Args:
        runs: To draw.
        folder: Of the files.
        show: Told what is being drawn.

    Returns:
        The figures in the order of the page, and what could not be drawn.
    """
    drawn: list[Drawn] = []
    left_out: list[LeftOut] = []
    for each in _all(runs, folder):
        show(each.name)
        try:
            drawn.append(Drawn(each.heading, each.caption, each.draw()))
        except SpikelaneError as error:
            left_out.append(LeftOut(each.caption, str(error)))
        except KeyError as error:
            left_out.append(LeftOut(each.caption, f'a run of another version, without {error}'))
    return drawn, left_out + list(_missing(runs))


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
    words = f'{_words(lap)}, {lap.lane} lane, seed {lap.seed}'

    @functools.cache  # both figures are of the same drive
    def seen() -> Seen:
        return drive_again(lap, _trajectory(lap))

    def draw_moving() -> tuple[Path, ...]:
        trajectory, events = seen()
        file = folder / 'animation.webp'
        return (draw_animation(trajectory, events, _course(lap), file, _title(lap)),)

    def draw_state() -> tuple[Path, ...]:
        events = seen().events
        last = max(StateImageParameters().frames, len(events) // 2)
        return draw_state_input(events[:last], folder / 'state_input', 'State input')

    yield _Figure('A lap', 'animation', f'Camera events beside the course: {words}', draw_moving)
    yield _Figure('Task', 'state_input', f'State input, half way: {words}', draw_state)


def _of_trainings(trainings: Sequence[TrainingRun], folder: Path) -> Iterator[_Figure]:
    from spikelane.figures.episodes import draw_episodes
    from spikelane.figures.state_images import draw_state_images
    from spikelane.figures.terminations import draw_terminations
    from spikelane.figures.weights import draw_weights

    for key, group in by_key(trainings).items():
        run = _median(group, lambda each: float(each.last_lane_loss_step))
        stem = f'{key.controller}_{_file_name(key)}'
        words = f'{key.words}: seed {run.seed}, the median of {len(group)}'
        if key.controller == 'dqn':

            def draw(run: TrainingRun = run, stem: str = stem) -> tuple[Path, ...]:
                lanes = tuple(_course(run).lanes)
                return draw_episodes(run, lanes, folder / f'{stem}_training', _title(run))

            def draw_states(run: TrainingRun = run, stem: str = stem) -> tuple[Path, ...]:
                states = read_states(run.folder)
                if not len(states):
                    raise SpikelaneError(f'{run.folder}: expected states met, got none')
                return draw_state_images(states, folder / f'{stem}_states', _title(run))

            heading = 'DQN training'
            yield _Figure(heading, f'{stem}_training', f'Episodes and rewards, {words}', draw)
            yield _Figure(heading, f'{stem}_states', f'States met, {words}', draw_states)
        elif key.controller == 'rstdp':

            def draw_learnt(run: TrainingRun = run, stem: str = stem) -> tuple[Path, ...]:
                file = folder / f'{stem}_weights'
                return draw_weights(_learnt(run), _encoding(run), file, _title(run))

            def draw_ends(run: TrainingRun = run, stem: str = stem) -> tuple[Path, ...]:
                file = folder / f'{stem}_terminations'
                return draw_terminations(run, _course(run), file, _title(run))

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

    caption = 'Weights of the Braitenberg controller'
    yield _Figure('Braitenberg controller', 'braitenberg_weights', caption, draw)


def _of_transfers(transfers: Sequence[TransferRun], folder: Path) -> Iterator[_Figure]:
    """Yield how the network learnt, and how its rates approach the activations."""
    from spikelane.figures.transfer import draw_accuracy, draw_rates

    for key, group in by_key(transfers).items():
        run = _median(group, lambda each: float(each.metrics['accuracy']))
        stem = f'transfer_{_file_name(key)}'
        words = f'{key.words}: seed {run.seed}, the median of {len(group)}'

        def draw_curve(run: TransferRun = run, stem: str = stem) -> tuple[Path, ...]:
            paper = paper_value('dqn_snn', run.scenario, 'accuracy')
            return draw_accuracy(
                run.curve, folder / f'{stem}_accuracy', _title(run), paper and paper.value
            )

        def draw_convergence(run: TransferRun = run, stem: str = stem) -> tuple[Path, ...]:
            return draw_rates(run.rates, folder / f'{stem}_rates', _title(run))

        caption = f'Accuracy over the training of the network, {words}'
        yield _Figure('Transfer', f'{stem}_accuracy', caption, draw_curve)
        caption = f'Firing rates against activations over the simulated time, {words}'
        yield _Figure('Transfer', f'{stem}_rates', caption, draw_convergence)


class Comparison(NamedTuple):
    """Drives that one figure compares, one of each group.

    Attributes:
        scenario: All are of.
        lane: All are of.
        number: Of the figures of this scenario and lane, from 1.
        of: How many these are.
        keys: Of the groups.
    """

    scenario: str
    lane: str
    number: int
    of: int
    keys: tuple[Key, ...]

    @property
    def name(self) -> str:
        """Name of the figure's files."""
        lane = '' if self.lane == PAPER_LANE else f'_{_plain(self.lane)}'
        part = '' if self.number == 1 else f'_{self.number}'
        return f'deviation_scenario_{_plain(self.scenario)}{lane}{part}'


def comparisons(chosen: Mapping[Place, Lap]) -> list[Comparison]:
    """Lay out which drives are compared with which.

    In the first figure of a scenario and lane are the paper's settings, or what comes nearest:
    of each controller its first group, the paper's setting before others; then the others, as
    many as there are figures for.
    """
    found = []
    for scenario, lane in _compared_places(chosen):
        keys = [
            place.key for place in chosen if (place.key.scenario, place.lane) == (scenario, lane)
        ]
        first = list({key.controller: key for key in reversed(keys)}.values())[::-1]
        rest = [key for key in keys if key not in first]
        parts = [
            tuple(some[start : start + _MOST_DRIVES])
            for some in (first, rest)
            for start in range(0, len(some), _MOST_DRIVES)
        ][:_MOST_COMPARISONS]
        found += [
            Comparison(scenario, lane, number, len(parts), part)
            for number, part in enumerate(parts, 1)
        ]
    return found


def _compared_places(chosen: Mapping[Place, Lap]) -> list[tuple[str, str]]:
    """Return the scenarios and lanes compared on; of others than the paper's only the first."""
    places = dict.fromkeys((place.key.scenario, place.lane) for place in chosen)
    # The paper's lane before the other, whichever was driven first.
    ordered = sorted(places, key=lambda each: (each[0], each[1] != PAPER_LANE))
    others = list(dict.fromkeys(s for s, _ in ordered if s not in PAPER_SCENARIOS))
    # Each lap of these is on a course of its own.
    others = [scenario for scenario in others if scenario != RANDOM_COURSES]
    shown = (*PAPER_SCENARIOS, *others[:_MOST_OTHER_COURSES])
    return [each for each in ordered if each[0] in shown]


def _compared(
    comparison: Comparison, chosen: Mapping[Place, Lap], laps: Sequence[Lap], folder: Path
) -> _Figure:
    from spikelane.figures.comparison import draw_comparison

    scenario, lane, number, of, keys = comparison
    shown = [chosen[Place(key, lane)] for key in keys]

    def draw() -> tuple[Path, ...]:
        labels = _distinct([_label(lap) for lap in shown])
        drives = {label: first_lap_of(lap) for label, lap in zip(labels, shown, strict=True)}
        title = f'Scenario {scenario}, {lane} lane'
        return draw_comparison(drives, _course(shown[0]), folder / comparison.name, title)

    part = f', {number} of {of}' if of > 1 else ''
    seeds = '; '.join(
        _which(lap, [each for each in laps if Place.of(each) == Place(key, lane)])
        for key, lap in zip(keys, shown, strict=True)
    )
    caption = f'Deviation over the first lap, scenario {scenario}, {lane} lane{part}. {seeds}'
    return _Figure('Laps', comparison.name, caption, draw)


def _which(lap: Lap, group: Sequence[Lap]) -> str:
    """Say which drive of a group is shown, and which are not."""
    setting = f' ({_cut(lap.setting, _ROW_LETTERS)})' if lap.setting else ''
    words = f'{shown_name(lap.controller)}{setting}: seed {lap.seed}'
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


def first_lap_of(lap: Lap) -> Trajectory:
    """Return the first lap of a drive, or all of it where there is none."""
    from spikelane.report.again import first_lap

    return first_lap(_trajectory(lap))


def _training_time(trainings: Sequence[TrainingRun], folder: Path) -> _Figure:
    from spikelane.figures.training_time import draw_training_time, TrainingTimes

    def draw() -> tuple[Path, ...]:
        by_group = by_key(trainings)
        labels = _distinct([_short(key) for key in by_group])
        groups = {
            label: TrainingTimes(
                [first_lap_step(run) for run in group],
                [stable_step(run) for run in group],
                style.RIGHT if key.controller == 'rstdp' else style.LEFT,
            )
            for label, (key, group) in zip(labels, by_group.items(), strict=True)
        }
        return draw_training_time(groups, folder / 'training_time', 'Training time')

    caption = 'Training time: simulated steps to the first lap and to stable driving'
    return _Figure('Training time', 'training_time', caption, draw)


def _missing(runs: Runs) -> Iterator[LeftOut]:
    """Name the paper's figures that no run was there for."""
    trained = {(run.controller, run.scenario) for run in runs.trainings}
    driven = {(lap.controller, lap.scenario) for lap in runs.laps if lap.lane == PAPER_LANE}
    for scenario in PAPER_SCENARIOS:
        for controller in ('dqn', 'rstdp'):
            if (controller, scenario) not in trained:
                what = f'{shown_name(controller)} training, scenario {scenario}'
                yield LeftOut(what, 'no run among these')
    for scenario, controllers in (('1', ORDER), ('2', ('dqn', 'dqn_snn', 'rstdp')), ('3', ORDER)):
        for controller in controllers if scenario != '3' else ('rstdp',):
            if (controller, scenario) not in driven:
                what = f'{shown_name(controller)} lap, scenario {scenario}, {PAPER_LANE} lane'
                yield LeftOut(what, 'no run among these')
    for scenario in ('1', '2'):
        if not any(run.scenario == scenario for run in runs.transfers):
            yield LeftOut(f'Transfer to DQN-SNN, scenario {scenario}', 'no run among these')
    if runs.laps and not any(lap.metrics.get('operations') for lap in runs.laps):
        why = 'counted of laps driven in one process, of which none is among these'
        yield LeftOut('Operations for a decision', why)
    yield from _not_compared(runs.laps)
    if not runs.laps:
        yield LeftOut('State input and animation of a lap', 'no lap among these runs')


def _not_compared(laps: Sequence[Lap]) -> Iterator[LeftOut]:
    """Name the courses and settings that no comparison is drawn of."""
    chosen = representative_laps(laps)
    shown = {Place(key, each.lane) for each in comparisons(chosen) for key in each.keys}
    scenarios = {place.key.scenario for place in shown}
    others = list(dict.fromkeys(lap.scenario for lap in laps if lap.scenario not in scenarios))
    if RANDOM_COURSES in others:
        others.remove(RANDOM_COURSES)
        yield LeftOut('Deviation on random courses', 'each lap is on a course of its own')
    if others:
        why = f"{_MOST_OTHER_COURSES} courses beside the paper's are drawn"
        yield LeftOut(f'Deviation on {", ".join(others)}', why)
    for place in chosen:
        if place not in shown and place.key.scenario in scenarios:
            why = f'{_MOST_COMPARISONS} figures for a scenario and lane; the table has it'
            yield LeftOut(f'Deviation, {place.key.words}, {place.lane} lane', why)


class Place(NamedTuple):
    """Where drives are laid together: those of one group on one lane."""

    key: Key
    lane: str

    @classmethod
    def of(cls, lap: Lap) -> Place:
        """Return that of a lap."""
        return cls(Key(lap.controller, lap.scenario, lap.setting), lap.lane)


def representative_laps(laps: Iterable[Lap]) -> dict[Place, Lap]:
    """Return a lap of each group and lane: completed, of median error."""
    chosen = {}
    for key, group in by_key(laps).items():
        for lane in dict.fromkeys(lap.lane for lap in group):
            on_lane = [lap for lap in group if lap.lane == lane]
            done = [lap for lap in on_lane if lap.metrics['completed']] or on_lane
            chosen[Place(key, lane)] = _median(
                done, lambda lap: float(lap.metrics['mean_abs_distance_m'])
            )
    return chosen


def _median(group: Sequence[Any], value: Callable[[Any], float]) -> Any:
    """Return the member in the middle, the lower one of two."""
    return sorted(group, key=value)[(len(group) - 1) // 2]


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


def first_lap_step(run: TrainingRun) -> float | None:
    """Return when the first lap was completed [steps of 50 ms], None where none was.

    DQN's episodes go on after a lap. Its robot drives at one speed, so that a lap is what an
    episode of the lane's length at that speed has.
    """
    if run.controller != 'dqn':
        laps = (e.step for e in run.terminations if e.reason == TERMINATED_LAPS_COMPLETE)
        return next((float(step) for step in laps), None)
    course = _course(run)
    radius_m = run.config['simulator']['robot.wheel_radius_m']
    per_step_m = run.config['dqn']['task.drive_rad_s'] * radius_m * STEP_S
    driven = 0
    for episode in run.terminations:
        needed = math.ceil(course.lane(episode.lane).length_m / per_step_m)
        if episode.episode_steps >= needed:
            return float(driven + needed)
        driven += episode.episode_steps
    return None


def stable_step(run: TrainingRun) -> float | None:
    """Return when it drove without losing the lane [steps of 50 ms], None where it never did."""
    if run.controller != 'dqn':
        return float(run.last_lane_loss_step) if run.has_settled else None
    if run.solved_episode is None:
        return None
    return float(sum(e.episode_steps for e in run.terminations[: run.solved_episode - 1]))


def _trajectory(lap: Lap) -> Trajectory:
    return read_csv(lap.folder / 'trajectory.csv')


def _course(run: Lap | TrainingRun) -> Course:
    return load_course(scenario_course(str(run.config['scenario'])))


def _encoding(run: TrainingRun) -> EncodingParameters:
    values = {
        name.removeprefix('encoding.'): value
        for name, value in run.config[run.controller].items()
        if name.startswith('encoding.')
    }
    return EncodingParameters.from_mapping(values, 'encoding')


def _title(run: Lap | TrainingRun | TransferRun) -> str:
    return f'{shown_name(run.controller)}, scenario {run.scenario}, seed {run.seed}'


def _words(lap: Lap) -> str:
    return Key(lap.controller, lap.scenario, lap.setting).words


def _label(lap: Lap) -> str:
    """Return what drove, in words that fit above its row of a figure."""
    name = shown_name(lap.controller)
    return f'{name} ({_cut(lap.setting, _ROW_LETTERS)})' if lap.setting else name


def _short(key: Key) -> str:
    """Return a group in words that fit beside its bar in a figure."""
    name = f'{shown_name(key.controller)}, scenario {key.scenario}'
    return '\n'.join([name, *_wrapped(key.setting)])


def _wrapped(setting: str) -> list[str]:
    """Return a setting in the lines that there is room for beside a bar."""
    lines = textwrap.wrap(setting, _BAR_LETTERS)
    if len(lines) <= _BAR_LINES:
        return lines
    return [*lines[: _BAR_LINES - 1], _cut(' '.join(lines[_BAR_LINES - 1 :]), _BAR_LETTERS)]


def _cut(text: str, letters: int) -> str:
    return text if len(text) <= letters else text[: letters - 4] + ' ...'


def _distinct(labels: Sequence[str]) -> list[str]:
    """Return labels with a number where the same came before."""
    return [
        label if (before := labels[:index].count(label)) == 0 else f'{label} ({before + 1})'
        for index, label in enumerate(labels)
    ]


def _file_name(key: Key) -> str:
    name = f'scenario_{_plain(key.scenario)}'
    setting = _plain(key.setting)
    if len(setting) > _FILE_LETTERS:  # what is cut off stays part of the name
        setting = f'{setting[:_FILE_LETTERS]}_{zlib.crc32(setting.encode()):08x}'
    return f'{name}_{setting}' if setting else name


def _plain(text: str) -> str:
    return '_'.join(''.join(c if c.isalnum() else ' ' for c in text).split())
