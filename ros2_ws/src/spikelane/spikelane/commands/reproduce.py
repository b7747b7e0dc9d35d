"""`spikelane reproduce`: everything the paper reports, from trainings to a page of results."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from spikelane.commands.experiment import (
    check_jobs,
    do_plan,
    is_finished,
    local_engine,
    RETRIES,
    summary,
)
import spikelane.experiment
from spikelane.experiment.file import (
    ExperimentRecord,
    MOST_SEEDS,
    read_experiment,
    with_robot,
    with_seeds,
)
from spikelane.experiment.plan import make_plan
from spikelane.experiment.processor_time import cost_table, costs, processor_s
from spikelane.experiment.runner import log_event
from spikelane.runs.arguments import add_robot_arguments, given_robot
from spikelane.runs.configuration import check_number
from spikelane.runs.folder import RUNS
from spikelane.runs.output import add_output_arguments, status_line
from spikelane_sim.robots import PYBULLET

#: Names of the experiments' files, which lie with the code that runs them.
PAPER, QUICK = 'paper', 'paper_quick'

#: In the experiment's folder.
REPORT = 'report'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        '--seeds',
        type=int,
        help='number of seeds of each training and evaluation, starting at seed 0 '
        '(default: 3; with --quick 1)',
    )
    parser.add_argument(
        '--quick',
        action='store_true',
        help='quick preview, which takes minutes: engine kinematic, one seed, shorter deep '
        'Q-learning; it is not a reproduction',
    )
    add_robot_arguments(parser)
    parser.add_argument(
        '--jobs', type=int, help='number of parallel runs (default: the number of processors)'
    )
    add_output_arguments(
        parser,
        f'folder of the runs and of {REPORT}/, new or to be resumed '
        f'(default: runs/{PAPER}; with --quick runs/{QUICK}; the name of another robot or engine '
        f'is appended, for example runs/{PAPER}_rigid)',
    )


def run(options: argparse.Namespace) -> int:
    """Do all runs that are not done yet, then report on them.

    Returns:
        0 where all runs are finished, 1 where one failed.

    Raises:
        SpikelaneError: An option is wrong, or the folder is in use or cannot be written.
    """
    check_jobs(options.jobs)
    check_number('--seeds', options.seeds, 1, MOST_SEEDS)
    record = read_experiment(experiment_file(QUICK if options.quick else PAPER))
    if options.seeds is not None:
        record = with_seeds(record, options.seeds)
    if robot := given_robot(options):
        record = with_robot(record, robot)
    plan = make_plan(record)
    root: Path = options.out or RUNS / plan.name
    results = do_plan(plan, root, lambda: local_engine(options.jobs), RETRIES, options.json)
    if not options.json:
        print(summary(results, root))
    # Where nothing came of any run there is nothing to report on, and why has been said.
    before_s = processor_s()
    report = _report(root, _note(record), options.json) if results['groups'] else None
    profile = costs(results, root, report=round(processor_s() - before_s, 3))
    log_event(root, 'profile', costs=[row._asdict() for row in profile])
    if options.json:
        print(json.dumps({**results, 'folder': str(root), 'report': report}))
    elif report is not None:
        print(f'{cost_table(profile)}\nreport in {report["page"]}')
    return 0 if is_finished(results) else 1


def experiment_file(name: str) -> Path:
    """Return the file of an experiment that comes along."""
    (folder,) = spikelane.experiment.__path__
    return Path(folder) / f'{name}.yaml'


def _note(record: ExperimentRecord) -> str:
    """Return what the report says of the experiment: what moved the robot, too."""
    names = dict.fromkeys(name for block in record.blocks for name in block.axes.get('robots', {}))
    return f'{record.description} Robot: {", ".join(names) or PYBULLET}.'


def _report(root: Path, note: str, is_quiet: bool) -> dict[str, Any]:
    # Here and not above: the figures take their time to be imported.
    from spikelane.report.page import write_report

    show = status_line(is_quiet)
    result = write_report([root], root / REPORT, show, note)
    show('\r')
    return result
