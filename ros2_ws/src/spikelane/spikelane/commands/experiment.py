"""`spikelane experiment`: run or resume all runs that a file describes, in parallel."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
import contextlib
import json
import os
from pathlib import Path
import sys
from typing import Any

from spikelane.experiment.engine import Engine
from spikelane.experiment.file import read_experiment
from spikelane.experiment.local import LocalEngine
from spikelane.experiment.plan import make_plan, Plan
from spikelane.experiment.results import experiment_results, write_results
from spikelane.experiment.runner import Runner, RunStatus
from spikelane.experiment.tasks import task_named
from spikelane.lock import locked
from spikelane.requirements import require
from spikelane.runs.configuration import check_number
from spikelane.runs.evaluate.summary import counted, units_in_words
from spikelane.runs.folder import make_folder, RunFolder, RUNS
from spikelane.runs.output import add_output_arguments
from spikelane_sim.errors import ParameterError

RETRIES = 2
AUTO, FLEET, LOCAL, RAY = 'auto', 'fleet', 'local', 'ray'

_STATES = {RunStatus.FOUND: 'finished', RunStatus.WAITING: 'to do'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        'file', type=Path, metavar='FILE', help='YAML file, such as experiments/rstdp.yaml'
    )
    parser.add_argument(
        '--jobs',
        type=int,
        help='number of processes at a time (default: the number of processors)',
    )
    parser.add_argument(
        '--engine',
        choices=(AUTO, FLEET, LOCAL, RAY),
        default=AUTO,
        help=f'{AUTO}: processes on this machine that do runs of one setting together, in one '
        f'compiled kernel where it has all that they need and they are long; {FLEET}: the same, '
        f'however short they are; {LOCAL}: a process for every run; {RAY}: a Ray cluster; the '
        f'results are the same bit for bit (default: {AUTO})',
    )
    parser.add_argument(
        '--address',
        help='address of the Ray cluster, whose machines must see the folder under the same path; '
        'if it needs a token, set RAY_AUTH_TOKEN (default: start a cluster on this machine)',
    )
    parser.add_argument(
        '--retries',
        type=int,
        default=RETRIES,
        help=f'how often a run is restarted after its process was killed (default: {RETRIES})',
    )
    parser.add_argument(
        '--dry-run', action='store_true', help='list the runs without executing them'
    )
    add_output_arguments(
        parser, 'folder of the experiment, new or to be resumed (default: runs/<name>)'
    )


def run(options: argparse.Namespace) -> int:
    """Do the experiment, or list its runs.

    Returns:
        0 where all runs are finished, 1 where one failed.

    Raises:
        SpikelaneError: The file or an option is wrong, or the folder is in use.
    """
    _check(options)
    plan = make_plan(read_experiment(options.file))
    root: Path = options.out or RUNS / plan.name
    if options.dry_run:
        _list(Runner(plan, root, options.retries), root, options.json)
        return 0
    results = do_plan(plan, root, lambda: _engine(options), options.retries, options.json)
    print(json.dumps({**results, 'folder': str(root)}) if options.json else summary(results, root))
    return 0 if is_finished(results) else 1


def _check(options: argparse.Namespace) -> None:
    check_jobs(options.jobs)
    check_number('--retries', options.retries, 0, 1000)
    if options.address is not None and options.engine != RAY:
        raise ParameterError('--address: expected together with --engine ray')


def check_jobs(jobs: int | None) -> None:
    """Check --jobs.

    Raises:
        ParameterError: It is too small or too large.
    """
    check_number('--jobs', jobs, 1, 10_000)


def do_plan(
    plan: Plan, root: Path, make_engine: Callable[[], Engine], retries: int, is_quiet: bool
) -> dict[str, Any]:
    """Do an experiment's runs in its folder, where no other command may be at work.

    Args:
        plan: The runs.
        root: The folder, new or to be resumed.
        make_engine: Makes what does them.
        retries: How often a run is begun again whose process was killed.
        is_quiet: Whether nothing is printed for people.

    Returns:
        The results (`experiment_results`), which are in the folder too, however it ends.

    Raises:
        SpikelaneError: The folder cannot be made or written, or is in use.
    """
    # Here and not above: drawing takes longer to import than a list of runs to make.
    from spikelane.experiment.table import shown

    require(task_named(each.task).requires(each.point.controller) for each in plan.runs)
    make_folder(root, exist_ok=True)
    with locked(root, patience_s=1.0):
        runner = Runner(plan, root, retries)
        try:
            # The standard output is for results; Ray would say there what it thinks of a
            # worker's end.
            with contextlib.redirect_stdout(sys.stderr):
                engine = make_engine()
                with shown(runner, engine.slots, is_quiet) as show:
                    runner.run(engine, show)
        except BaseException as error:
            if not isinstance(error, Exception):  # Ctrl-C, or SIGTERM
                finished = runner.counts.finished
                print(
                    f'stopped, {finished} of {runner.counts.total} runs are finished; '
                    f'the same command goes on',
                    file=sys.stderr,
                )
            raise
        finally:
            results = experiment_results(plan.name, list(runner.statuses.values()))
            write_results(RunFolder(root), results)
    return results


def is_finished(results: Mapping[str, Any]) -> bool:
    """Return whether all runs of an experiment are."""
    return all(RunStatus(each['state']).is_finished for each in results['runs'])


def local_engine(jobs: int | None, name: str = AUTO) -> LocalEngine:
    """Return what does runs on this machine.

    Args:
        jobs: Processes at a time; None for as many as there are processors.
        name: Which of those that `--engine` offers.
    """
    return LocalEngine(
        jobs or os.cpu_count() or 1, does_together=name != LOCAL, is_in_kernel=name == FLEET
    )


def _engine(options: argparse.Namespace) -> Engine:
    if options.engine != RAY:
        return local_engine(options.jobs, options.engine)
    from spikelane.experiment.ray import RayEngine

    return RayEngine(options.address, options.jobs)


def _list(runner: Runner, root: Path, is_json: bool) -> None:
    rows = [
        {
            'name': status.run.name,
            'state': 'to go on'
            if status.state is RunStatus.WAITING and status.is_begun
            else _STATES[status.state],
            'needs': status.run.before,
            'folder': None if status.folder is None else status.folder.path.name,
        }
        for status in runner.statuses.values()
    ]
    if is_json:
        print(json.dumps({'folder': str(root), 'runs': rows}))
        return
    for row in rows:
        after = f', after {row["needs"]}' if row['needs'] else ''
        print(f'{row["state"]:9} {row["name"]}{after}')
    done = sum(row['state'] == 'finished' for row in rows)
    print(f'{len(rows)} runs, {done} finished, in {root}')


def summary(results: Mapping[str, Any], root: Path) -> str:
    """Return the results for people: a line for each group, then what failed."""
    lines = []
    for group in results['groups']:
        place = [str(value) for name, value in group.items() if isinstance(value, str)]
        seeds = len(group['seeds'])
        # Laps are described by what was driven: one run of an evaluation can have many seeds.
        units = units_in_words(group['laps']['all']) if 'laps' in group else counted(seeds, 'seed')
        text = f'{" ".join(place)}, {units}'
        if 'laps' in group:
            completed = group['laps']['all']['completed']
            error = group['laps']['all']['mean_abs_distance_m']
            text += f': {completed["successes"]} of {completed["n"]} laps completed'
            text += '' if error is None else f', mean error {error["mean"]:.4f} m'
        elif 'accuracy' in group['metrics']:
            text += f': accuracy {group["metrics"]["accuracy"]["mean"]:.2%}'
        lines.append(text)
    for each in results['runs']:
        if each['state'] in ('failed', 'blocked'):
            lines.append(f'{each["state"]} {each["name"]}: {each["message"]}')
    return '\n'.join([*lines, f'results in {root / "results.json"}'])
