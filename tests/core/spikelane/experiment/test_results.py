"""Results of an experiment: which runs are laid together, and which laps counted."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from spikelane.commands.experiment import summary
from spikelane.experiment.file import read_experiment
from spikelane.experiment.plan import make_plan, PlannedRun
from spikelane.experiment.results import experiment_results
from spikelane.experiment.runner import RunStatus, Status
from spikelane.runs.evaluate.summary import MEASURES, MEASURES_OF_ALL
from spikelane.runs.folder import RunFolder


def lap(seed: int, error_m: float) -> dict[str, Any]:
    """Return a lap that was completed."""
    others = dict.fromkeys((*MEASURES, *MEASURES_OF_ALL), 0.0)
    own = {'course': '1', 'lane': 'outer', 'seed': seed, 'completed': True}
    return {**others, **own, 'mean_abs_distance_m': error_m}


def groups(folder: Path, matrix: str, laps: dict[int, list[dict[str, Any]]]) -> list[Any]:
    """Return the groups of an experiment's results, its runs' laps by seed."""
    file = folder / 'plan.yaml'
    file.write_text(f'name: tiny\nmatrix:\n{matrix}')

    def done(run: PlannedRun) -> Status:
        path = folder / run.name
        path.mkdir()
        metrics = {'steps': 10} | ({'laps': laps[run.point.seed]} if laps else {})
        (path / 'metrics.json').write_text(json.dumps(metrics))
        return Status(run, RunStatus.DONE, RunFolder(path))

    statuses = [done(run) for run in make_plan(read_experiment(file)).runs]
    found: list[Any] = experiment_results('tiny', statuses)['groups']
    return found


def test_runs_that_differ_in_more_than_the_seed_are_not_laid_together(tmp_path: Path) -> None:
    """An example is the length of a training, which is not an axis."""
    found = groups(
        tmp_path,
        """
  - {controllers: [rstdp], scenarios: [1], seeds: [0, 1], tasks: {train: {steps: 100}}}
  - {controllers: [rstdp], scenarios: [1], seeds: [1, 2], tasks: {train: {steps: 200}}}
""",
        {},
    )
    assert [(each['controller'], each['seeds']) for each in found] == [
        ('rstdp', [0, 1]),
        ('rstdp', [1, 2]),
    ]


def test_the_same_lap_counts_once(tmp_path: Path) -> None:
    """Several evaluations without a training may have overlapping seeds."""
    found = groups(
        tmp_path,
        """
  controllers: [braitenberg]
  scenarios: [1]
  seeds: [0, 1]
  tasks: {evaluate: {seeds: 2}}
""",
        {0: [lap(0, 0.01), lap(1, 0.02)], 1: [lap(1, 0.02), lap(2, 0.06)]},
    )
    [group] = found
    assert group['laps']['all']['completed']['n'] == 3
    assert group['laps']['all']['mean_abs_distance_m']['mean'] == 0.03


def test_a_lap_counts_for_each_training(tmp_path: Path) -> None:
    """The same seed with other weights is another lap."""
    _, group = groups(
        tmp_path,
        """
  controllers: [rstdp]
  scenarios: [1]
  seeds: [0, 1]
  tasks: {train: {steps: 100}, evaluate: {seeds: 2}}
""",
        {0: [lap(0, 0.01), lap(1, 0.02)], 1: [lap(1, 0.02), lap(2, 0.06)]},
    )
    assert group['laps']['all']['completed']['n'] == 4


def test_trainings_that_have_not_got_there_are_censored(tmp_path: Path) -> None:
    """A last lane loss without a lap after it, and a training that was not solved by its end."""
    file = tmp_path / 'plan.yaml'
    file.write_text(
        'name: tiny\nmatrix: {controllers: [rstdp], seeds: 3, tasks: {train: {steps: 100}}}\n'
    )
    found = [(10, True, 40), (20, False, None), (30, True, 60)]
    statuses = []
    for run, (last, settled, solved) in zip(
        make_plan(read_experiment(file)).runs, found, strict=True
    ):
        path = tmp_path / run.name
        path.mkdir()
        metrics = {'steps': 100, 'last_lane_loss_step': last, 'settled': settled}
        (path / 'metrics.json').write_text(json.dumps({**metrics, 'solved_by': solved}))
        statuses.append(Status(run, RunStatus.DONE, RunFolder(path)))
    [group] = experiment_results('tiny', statuses)['groups']
    assert set(group['metrics']) == {'steps'}
    last, solved_by = group['times']['last_lane_loss_step'], group['times']['solved_by']
    # 2/3 go on after 10; the one that is censored at 20 leaves one, whose loss is at 30.
    assert (last['median'], last['reached'], last['n']) == (30.0, 2, 3)
    assert (solved_by['median'], solved_by['max'], solved_by['max_reached']) == (
        60.0,
        100.0,
        False,
    )


def test_the_summary_counts_what_was_driven(tmp_path: Path) -> None:
    """An evaluation has its own seeds; a training is one seed, not "1 seeds"."""
    completed = {'successes': 3, 'n': 4}
    every = {'unit': 'seed', 'units': 4, 'laps': 4, 'distinct_laps': 4}
    laps = {'all': {**every, 'completed': completed, 'mean_abs_distance_m': None}}
    groups = [
        {'task': 'evaluate', 'controller': 'rstdp', 'seeds': [0], 'metrics': {}, 'laps': laps},
        {'task': 'train', 'controller': 'rstdp', 'seeds': [0], 'metrics': {}},
        {'task': 'train', 'controller': 'dqn', 'seeds': [0, 1], 'metrics': {}},
    ]
    assert summary({'groups': groups, 'runs': []}, tmp_path).splitlines() == [
        'evaluate rstdp, 4 seeds: 3 of 4 laps completed',
        'train rstdp, 1 seed',
        'train dqn, 2 seeds',
        f'results in {tmp_path}/results.json',
    ]
