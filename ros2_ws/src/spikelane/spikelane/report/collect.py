"""Finds runs in folders, however deep they are, and reads what they left.

A folder is known by its `config.yaml` (`run_folder`), a training without one by its checkpoint.
What cannot be used is not an error: it is named, with the reason.
"""

from __future__ import annotations

import collections
from collections.abc import Iterator, Mapping, Sequence
import json
import os
from pathlib import Path
from typing import Any

from spikelane.experiment.plan import RUN_FILE
from spikelane.experiment.sweeps import swept_parameters
from spikelane.report.kinds import (
    check_config,
    EvaluationMetrics,
    LapMetrics,
    LapOfEvaluation,
    Results,
    UNUSABLE,
)
from spikelane.report.runs import (
    Conditions,
    Lap,
    LeftOut,
    RANDOM_COURSES,
    Runs,
    TrainingRun,
    TransferRun,
)
from spikelane.report.settings import checkpoint_of, scenario_name, setting_of
from spikelane.runs.evaluate.summary import check_lap
from spikelane.runs.folder import RunFolder
from spikelane.runs.input_files import transferred_controller
from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_controllers.learning.results import FinishedRun
from spikelane_controllers.registry import (
    controller_class,
    training_names,
    training_results,
    transfer_results,
)
from spikelane_controllers.saved_state import mapping
from spikelane_sim.errors import CheckpointError, SpikelaneError
from spikelane_sim.files import FileError
from spikelane_sim.kinds import check_kind, KindError
from spikelane_sim.parsing import ParseError, read_json_file, read_yaml_file
from spikelane_sim.random_course import PREFIX as RANDOM_PREFIX

_RESULTS_FILE = 'results.json'


class ReportError(SpikelaneError):
    """There is nothing to report on."""

    exit_status = 2


def collect(paths: Sequence[Path]) -> Runs:
    """Find all runs in folders and the folders in them.

    Args:
        paths: Folders of runs, or above them; what is found twice counts once.

    Raises:
        ReportError: One is no folder, or there is no run in any.
    """
    runs = Runs()
    seen: set[Path] = set()
    former: collections.Counter[Path] = collections.Counter()
    for path in paths:
        if not path.is_dir():
            raise ReportError(f'{path}: expected a folder of runs, got none')
        for folder in _folders(path):
            if folder.resolve() not in seen:
                seen.add(folder.resolve())
                if _is_former(runs, folder):
                    former[folder.parent] += 1
                else:
                    _add(runs, folder)
    for root, count in former.items():
        why = 'the experiment was changed after they were made, and other runs took their places'
        runs.left_out.append(LeftOut(f'{root}: {count} runs', why))
    for found in (runs.laps, runs.trainings, runs.transfers):
        runs.left_out.extend(_without_copies(found))
    if not runs:
        why = f' ({runs.left_out[0].what}: {runs.left_out[0].why})' if runs.left_out else ''
        names = ', '.join(map(str, paths))
        raise ReportError(f'{names}: expected finished runs, got none{why}')
    return runs


def _without_copies(runs: list[Any]) -> Iterator[LeftOut]:
    """Take out, and yield, what is a copy of another: the same seed and setting, and outcome.

    Else one run would count as two of a group.
    """
    firsts: dict[str, Path] = {}
    for run in tuple(runs):
        first = firsts.setdefault(_outcome(run), run.folder)
        if first != run.folder:
            runs.remove(run)
            yield LeftOut(str(run.folder), f'it is a copy of {first}, and a run counts once')


def _outcome(run: Lap | TrainingRun | TransferRun) -> str:
    """Return what two runs that are not copies of one differ in."""
    parts: list[Any] = [run.controller, run.scenario, run.setting, run.seed]
    if isinstance(run, Lap):
        names = ('steps', 'mean_abs_distance_m', 'max_abs_distance_m')
        parts += [run.lane, run.config['scenario'], *(run.metrics.get(name) for name in names)]
    elif isinstance(run, TrainingRun):
        parts += [run.results.terminations, run.results.episode_columns()]
    else:
        parts += run.results.measures()
    return json.dumps(parts)


def _folders(path: Path) -> Iterator[Path]:
    """Yield folders of runs in the order of their names; a run's own folders are not entered."""
    for name, folders, files in os.walk(path):
        folder = Path(name)
        folders.sort()
        if 'config.yaml' in files or 'checkpoint.safetensors' in files:
            folders.clear()
            yield folder
        elif _RESULTS_FILE in files:
            yield folder


def _is_former(runs: Runs, folder: Path) -> bool:
    """Return whether another folder has taken its place, as the experiment was changed since."""
    folders = runs.listed.get(folder.parent, {})
    return folders.get(_run_name(folder), folder.name) != folder.name


def _run_name(folder: Path) -> str:
    """Return the name that an experiment has for a run, '' for a run of none."""
    try:
        return str(read_json_file(folder / RUN_FILE)['name'])
    except (ParseError, KeyError, TypeError):
        return ''


def _add(runs: Runs, folder: Path) -> None:
    """Add what a folder holds, or why it holds nothing of use."""
    try:
        if (folder / 'config.yaml').exists():
            _add_run(runs, folder)
        elif (folder / 'checkpoint.safetensors').exists():
            runs.trainings.append(_training_of_checkpoint(folder))
        else:
            _add_experiment(runs, folder)
    except UNUSABLE as error:
        why = f'its files do not fit this version of Spikelane: {error!r}'
        why = str(error) if isinstance(error, SpikelaneError) else why
        runs.left_out.append(LeftOut(str(folder), why))


def _add_run(runs: Runs, folder: Path) -> None:
    try:
        config = check_kind(read_yaml_file(folder / 'config.yaml'), dict[str, Any])
        if not (folder / 'metrics.json').exists():
            raise FileError(
                f'the run has not finished: metrics.json is missing{_how_far(folder, config)}'
            )
        config = check_config(config)
    except (ParseError, KindError) as error:
        raise FileError(f'config.yaml: {error}') from None
    metrics = RunFolder(folder).read_metrics()
    if 'transfer' not in config:
        controller_class(str(config.get('controller')))  # that there is one
    if 'training' in config:
        runs.trainings.append(_training(folder, config, metrics))
    elif 'transfer' in config:
        runs.transfers.append(_transfer(folder, config, metrics))
    elif 'evaluation' in config:
        runs.laps.extend(list(_evaluated(folder, config, metrics)))  # all of them or none
    elif 'lane' in config:
        runs.laps.append(_lap(folder, config, metrics, config['lane'], config['seed']))
    else:
        raise FileError('config.yaml: expected a lap, an evaluation, a training or a transfer')


def _how_far(folder: Path, config: Mapping[str, Any]) -> str:
    """Say how far a training is that is not finished, where its checkpoint tells."""
    steps = config.get('training', {}).get('steps')
    try:
        done = read_checkpoint(folder, str(config.get('controller'))).facts.get('steps')
    except CheckpointError:
        return ''
    return f', at step {done:,} of {steps:,}' if steps and isinstance(done, int) else ''


def _lap(
    folder: Path,
    config: Mapping[str, Any],
    metrics: Mapping[str, Any],
    lane: str,
    seed: int,
    scenario: str = '',
) -> Lap:
    _check_lap(metrics)
    return Lap(
        controller=config['controller'],
        scenario=scenario or scenario_name(config),
        seed=seed,
        **setting_of(config, folder)._asdict(),
        folder=folder,
        config=config,
        metrics=metrics,
        lane=lane,
        training=checkpoint_of(config),
    )


def _evaluated(
    folder: Path, config: Mapping[str, Any], metrics: Mapping[str, Any]
) -> Iterator[Lap]:
    """Yield an evaluation's laps; each has a folder of its own."""
    _check(metrics, EvaluationMetrics)
    several = len({row['course'] for row in metrics['laps']}) > 1
    given = bool(config['evaluation'].get('courses')) or several
    names = sorted(path.parent.name for path in RunFolder(folder).laps.glob('*/metrics.json'))
    for name in names:
        path = RunFolder(folder).laps / name
        row = RunFolder(path).read_metrics(LapOfEvaluation)
        own = {'scenario': row['course'], 'evaluated_for': config['scenario']}
        where = {**config, **own} if given else config
        is_one_of_many = several and row['course'].startswith(RANDOM_PREFIX)
        scenario = RANDOM_COURSES if is_one_of_many else ''
        yield _lap(path, where, row, row['lane'], row['seed'], scenario)


def _training(folder: Path, config: Mapping[str, Any], metrics: Mapping[str, Any]) -> TrainingRun:
    controller = config['controller']
    results = training_results(controller)(FinishedRun(controller, folder, config, metrics))
    return TrainingRun(
        controller=controller,
        scenario=scenario_name(config),
        seed=config['seed'],
        setting=setting_of(config, folder).setting,
        learnt_steps=results.steps,
        folder=folder,
        config=config,
        metrics=metrics,
        results=results,
    )


def _training_of_checkpoint(folder: Path) -> TrainingRun:
    """Return a training of which only its checkpoint was kept."""
    for name in training_names():
        try:
            facts = read_checkpoint(folder, name).facts
        except CheckpointError:
            continue
        if 'terminations' in facts:
            # A node learns wherever its topics come from.
            if 'scenario' not in mapping(facts, 'config'):
                raise CheckpointError('checkpoint.safetensors: does not say what was driven on')
            return _training(folder, check_config(facts['config']), {})
    raise CheckpointError("checkpoint.safetensors: expected a training's checkpoint")


def _transfer(folder: Path, config: Mapping[str, Any], metrics: Mapping[str, Any]) -> TransferRun:
    controller = transferred_controller(config)
    return TransferRun(
        controller=controller,
        scenario=scenario_name(config),
        seed=config['seed'],
        **setting_of(config, folder)._asdict(),
        folder=folder,
        config=config,
        metrics=metrics,
        results=transfer_results(controller)(FinishedRun(controller, folder, config, metrics)),
    )


def _check_lap(metrics: Mapping[str, Any]) -> None:
    """Check that metrics have what the tables of laps are made of.

    Raises:
        FileError: Something is missing or of another kind.
    """
    _check(metrics, LapMetrics)
    try:
        check_lap(metrics)
    except KindError as error:
        raise FileError(f'metrics.json: {error}') from None


def _check(metrics: Mapping[str, Any], kind: Any) -> None:
    try:
        check_kind(metrics, kind)
    except KindError as error:
        raise FileError(f'metrics.json: {error}') from None


def _add_experiment(runs: Runs, folder: Path) -> None:
    """Add an experiment's conditions, and name those of its runs that came to nothing."""
    results = RunFolder(folder).read_json(_RESULTS_FILE, Results)
    listed = results['runs']
    runs.left_out.extend(
        LeftOut(f'{folder}: {run["name"]}', run.get('message', ''))
        for run in listed
        if run['state'] in ('failed', 'blocked')
    )
    runs.listed[folder] = {run['name']: run['folder'] for run in listed if run.get('folder')}
    # Those that were begun have a folder, and are found there.
    waiting = sum(run['state'] == 'waiting' and not run.get('folder') for run in listed)
    if waiting:
        runs.left_out.append(
            LeftOut(
                f'{folder}: {waiting} of {len(listed)} runs',
                'the experiment has not begun them yet',
            )
        )
    runs.variants.update(
        {
            folder / run['folder']: run['variants']
            for run in listed
            if run.get('folder') and run.get('variants')
        }
    )
    if any(group.get('conditions') for group in results.get('groups', ())):
        runs.conditions.append(Conditions(folder, results))
    if swept_parameters(results):
        runs.swept.append(Conditions(folder, results))
