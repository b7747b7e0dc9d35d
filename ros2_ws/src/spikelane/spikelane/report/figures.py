"""The report's figures, each drawn anew from what runs left, and named by what it shows.

What cannot be drawn because no run has what it takes is named with the reason.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
import functools
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast, NamedTuple
import zlib

from spikelane.figures import style
from spikelane.report.collect import Lap, LeftOut, Runs, TrainingRun
from spikelane.report.tables import by_key, Key, ORDER, PAPER_LANE, shown_name
from spikelane.trajectory import read_csv, Trajectory
from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_controllers.registry import training_class
from spikelane_controllers.training import LearningController, PlasticTraining, Training
from spikelane_controllers.weights import WEIGHTS
from spikelane_sim.contract import STEP_S, TERMINATED_LAPS_COMPLETE
from spikelane_sim.course import Course, load_course, scenario_course
from spikelane_sim.encoding import EncodingParameters, StateImageParameters
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.files import FileError
from spikelane_sim.task import DecisionParameters

#: Drives in one comparison; more cannot be told apart.
_MOST_DRIVES = 8

#: Letters of a setting that there is room for.
_ROW_LETTERS, _BAR_LETTERS, _FILE_LETTERS = 100, 40, 60


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

    Raises:
        FileError: A file cannot be written.
    """
    drawn: list[Drawn] = []
    left_out: list[LeftOut] = []
    for each in _all(runs, folder):
        show(each.name)
        try:
            drawn.append(Drawn(each.heading, each.caption, each.draw()))
        except FileError:
            raise  # no figure could be written then
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
    chosen = _representative_laps(runs.laps)
    yield from _of_a_lap(chosen, folder)
    yield from _of_trainings(runs.trainings, folder)
    yield from _braitenberg(folder)
    yield from _comparisons(chosen, folder)
    if runs.trainings:
        yield _training_time(runs.trainings, folder)


def _of_the_task(folder: Path) -> Iterator[_Figure]:
    from spikelane.figures.rewards import draw_rewards
    from spikelane.figures.scenarios import draw_scenarios

    caption = 'The course and its three scenarios'
    yield _Figure(
        'Task', 'scenarios', caption, lambda: draw_scenarios(folder / 'scenarios', 'The course')
    )
    caption = 'Rewards over the distance from the lane centre'
    yield _Figure('Task', 'rewards', caption, lambda: draw_rewards(folder / 'rewards', 'Rewards'))


def _of_a_lap(chosen: Mapping[Key, Lap], folder: Path) -> Iterator[_Figure]:
    """Yield what is drawn of one lap with what its camera saw, in the first scenario there is."""
    from spikelane.figures.animation import draw_animation
    from spikelane.figures.state_input import draw_state_input
    from spikelane.report.again import drive_again, Seen

    best = [lap for lap in chosen.values() if lap.metrics['completed']] or [*chosen.values()]
    if not best:
        return
    of_first = [lap for lap in best if lap.scenario == best[0].scenario]
    lap = of_first[-1]  # of the last controller in the paper's order
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
    from spikelane.figures.terminations import draw_terminations
    from spikelane.figures.weights import draw_weights

    for key, group in by_key(trainings).items():
        run = _median(group, lambda each: float(each.last_lane_loss_step))
        stem = f'{key.controller}_{_file_name(key)}'
        words = f'{key.words}: seed {run.seed}, the median of {len(group)}'
        if key.controller == 'dqn':

            def draw(run: TrainingRun = run, stem: str = stem) -> tuple[Path, ...]:
                lanes = tuple(_course(run).lanes)
                return draw_episodes(
                    cast(Any, _past(run)), lanes, folder / f'{stem}_training', _title(run)
                )

            yield _Figure(
                'DQN training', f'{stem}_training', f'Episodes and rewards, {words}', draw
            )
        elif key.controller == 'rstdp':

            def draw_learnt(run: TrainingRun = run, stem: str = stem) -> tuple[Path, ...]:
                past = cast(PlasticTraining, _past(run))
                return draw_weights(past, _encoding(run), folder / f'{stem}_weights', _title(run))

            def draw_ends(run: TrainingRun = run, stem: str = stem) -> tuple[Path, ...]:
                return draw_terminations(
                    _past(run), _course(run), folder / f'{stem}_terminations', _title(run)
                )

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


def _comparisons(chosen: Mapping[Key, Lap], folder: Path) -> Iterator[_Figure]:
    """Yield a comparison for each scenario."""
    from spikelane.figures.comparison import draw_comparison

    for scenario in dict.fromkeys(key.scenario for key in chosen):
        laps = [lap for key, lap in chosen.items() if key.scenario == scenario][:_MOST_DRIVES]
        name = f'deviation_scenario_{_plain(scenario)}'

        def draw(laps: Sequence[Lap] = laps, name: str = name) -> tuple[Path, ...]:
            labels = _distinct([_label(lap) for lap in laps])
            drives = {label: first_lap_of(lap) for label, lap in zip(labels, laps, strict=True)}
            return draw_comparison(
                drives, _course(laps[0]), folder / name, f'Scenario {laps[0].scenario}'
            )

        lanes = ', '.join(dict.fromkeys(f'{lap.lane} lane' for lap in laps))
        caption = (
            f'Deviation over the first lap, scenario {scenario}, {lanes}; of each the median seed'
        )
        yield _Figure('Laps', name, caption, draw)


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
    for scenario in ('1', '2', '3'):
        for controller in ('dqn', 'rstdp'):
            if (controller, scenario) not in trained:
                what = f'{shown_name(controller)} training, scenario {scenario}'
                yield LeftOut(what, 'no run among these')
    for scenario, controllers in (('1', ORDER), ('2', ('dqn', 'dqn_snn', 'rstdp')), ('3', ORDER)):
        for controller in controllers if scenario != '3' else ('rstdp',):
            if (controller, scenario) not in driven:
                what = f'{shown_name(controller)} lap, scenario {scenario}, {PAPER_LANE} lane'
                yield LeftOut(what, 'no run among these')
    if not runs.laps:
        yield LeftOut('State input and animation of a lap', 'no lap among these runs')


def _representative_laps(laps: Iterable[Lap]) -> dict[Key, Lap]:
    """Return a lap of each group: on the paper's lane, completed, of median error."""
    chosen = {}
    for key, group in by_key(laps).items():
        lane = PAPER_LANE if any(lap.lane == PAPER_LANE for lap in group) else group[0].lane
        on_lane = [lap for lap in group if lap.lane == lane]
        done = [lap for lap in on_lane if lap.metrics['completed']] or on_lane
        chosen[key] = _median(done, lambda lap: float(lap.metrics['mean_abs_distance_m']))
    return chosen


def _median(group: Sequence[Any], value: Callable[[Any], float]) -> Any:
    """Return the member in the middle, the lower one of two."""
    return sorted(group, key=value)[(len(group) - 1) // 2]


def _past(run: TrainingRun) -> Training:
    """Return a training as figures know it, from its checkpoint."""
    arrays = read_checkpoint(run.folder, run.controller).arrays
    weights = SimpleNamespace(weights_pa=arrays.get(WEIGHTS))
    cls = training_class(run.controller)
    values = run.config.get('training', {})
    parameters = cls.parameters_class(
        steps=run.steps, save_every=values.get('save_every', run.config.get('save_every', 1))
    )
    # Not the class's own beginning, which opens files to go on training.
    past = cls.__new__(cls)
    past.__dict__.update(
        controller=cast(LearningController, weights),
        _parameters=parameters,
        steps=run.steps,
        terminations=list(run.terminations),
        outcomes=list(run.outcomes),
        weight_history=list(arrays.get('training.weight_history', ())),
    )
    return past


def first_lap_step(run: TrainingRun) -> float | None:
    """Return when the first lap was completed [steps of 50 ms], None where none was.

    DQN's episodes go on after a lap. Its robot drives at one speed, so that a lap is what an
    episode of the lane's length at that speed has.
    """
    if run.controller != 'dqn':
        laps = (e.step for e in run.terminations if e.reason == TERMINATED_LAPS_COMPLETE)
        return next((float(step) for step in laps), None)
    course, values = _course(run), run.config['dqn']
    radius_m = run.config['simulator']['robot.wheel_radius_m']
    drive_rad_s = values.get('decision.drive_rad_s', DecisionParameters().drive_rad_s)
    per_step_m = drive_rad_s * radius_m * STEP_S
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


def _title(run: Lap | TrainingRun) -> str:
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
    return f'{name}\n{_cut(key.setting, _BAR_LETTERS)}' if key.setting else name


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
