"""The report's tables, against numbers worked out by hand."""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spikelane.report.groups import by_key, seeds_in_words, Table
from spikelane.report.measured import LAP_MEASURES
from spikelane.report.paper import paper_value
from spikelane.report.runs import Conditions, Lap, Runs, TrainingRun, TransferRun
from spikelane.report.tables import all_tables
from spikelane_controllers.checkpoint import write_checkpoint
from spikelane_controllers.learning.results import FinishedRun
from spikelane_controllers.learning.training import Termination
from spikelane_controllers.operations import Operations
from spikelane_controllers.registry import cards, transfer_results


def run_of(cls: Any, controller: str, seed: int, **others: Any) -> Any:
    """Make a run in scenario 1 with the paper's setting."""
    values = {'setting': '', 'folder': Path('x'), 'config': {}, 'metrics': {}, **others}
    return cls(controller=controller, scenario='1', seed=seed, **values)


def lap(seed: int, error_m: float, completed: bool = True, lane: str = 'outer') -> Lap:
    """Make a lap of DQN."""
    metrics = {
        'completed': completed,
        'mean_abs_distance_m': error_m,
        'mean_distance_m': -error_m / 2,
        'max_abs_distance_m': 3 * error_m,
        'lap_time_s': 200.0 + seed if completed else None,
    }
    found: Lap = run_of(Lap, 'dqn', seed, metrics=metrics, lane=lane)
    return found


Train = Callable[[int, int, bool], TrainingRun]


@pytest.fixture
def training(finish_training: Any) -> Train:
    """Give what makes a training of R-STDP that lost its lane last at a step."""

    def make(seed: int, last: int, settled: bool) -> TrainingRun:
        ends = [Termination(last, 1, 'outer', 'B', 6.0, 0.2, last, 'lane_lost')]
        for episode, lane in enumerate(('inner', 'outer') if settled else ('inner',), 2):
            step = last + 4000 * episode
            ends.append(Termination(step, episode, lane, 'A', 0.5, 0.0, 4000, 'laps_complete'))
        results = finish_training('rstdp', ends, steps=30_000)
        found: TrainingRun = run_of(TrainingRun, 'rstdp', seed, results=results)
        return found

    return make


Transfer = Callable[[int, float], TransferRun]


@pytest.fixture
def transfer(tmp_path: Path) -> Transfer:
    """Give what makes a transfer of an accuracy."""
    rates = [
        {'simulated_ms': 10.0, 'hidden': 0.3, 'output': 0.25, 'agreement': 0.5},
        {'simulated_ms': 1000.0, 'hidden': 0.02, 'output': 0.01, 'agreement': 0.9},
    ]
    file = tmp_path / 'checkpoint.safetensors'
    write_checkpoint(file, 'dqn_snn', {'a': np.zeros(2)}, {'curve': []})

    def make(seed: int, accuracy: float) -> TransferRun:
        metrics = {
            'accuracy': accuracy,
            'training_accuracy': 0.96,
            'states': 50_000,
            'maximum': 9,
            'rates': {'reset to 0': rates, 'less the threshold': []},
        }
        run = FinishedRun('dqn_snn', tmp_path, {'scenario': '1'}, metrics)
        results = transfer_results('dqn_snn')(run)
        found: TransferRun = run_of(TransferRun, 'dqn_snn', seed, results=results)
        return found

    return make


def table(runs: Runs, title: str) -> Table:
    """Return the table of a title."""
    return next(each for each in all_tables(runs) if each.title == title)


def test_results_stand_next_to_the_papers() -> None:
    """Mean 0.04, s = 0.01; log-scale half 4.302653 * 0.01 / sqrt(3) / 0.04 = 0.62103."""
    runs = Runs(laps=[lap(2, 0.05), lap(0, 0.03), lap(1, 0.04), lap(3, 0.9, completed=False)])
    error, steps = table(runs, "Results against the paper's").rows
    assert error == (
        'mean error, outer lane',
        'DQN',
        '1',
        "the paper's",
        '0.041 m',
        '0.0400 ± 0.0100 m (0.0215 to 0.0744)',
        '0.0400 m (0.0300 to 0.0500)',
        '—',
        '3 of 4 seeds',
        '0 to 3',
        'section 6',
    )
    # Laps of 200, 201 and 202 s are 4,000, 4,020 and 4,040 steps of 50 ms.
    assert steps[4:9] == (
        'about 5,000',
        '4,020 ± 20 (3,971 to 4,070)',
        '4,020 (4,000 to 4,040)',
        '—',
        '3 of 4 seeds',
    )


def test_the_other_lane_is_not_compared_with_the_paper() -> None:
    """The paper has results for the outer lane only."""
    runs = Runs(laps=[lap(0, 0.03, lane='inner')])
    assert [each.title for each in all_tables(runs)] == [
        'Success with learning off',
        'Laps',
        'Every seed',
    ]
    [row] = table(runs, 'Laps').rows
    assert row == (
        'DQN',
        '1',
        "the paper's",
        'inner',
        '1 of 1 (21% to 100%)',
        '0.0300 m',
        '0.0300 m',
        '-0.0150 m',
        '0.0900 m',
        '4,000',
        '1 seed',
        '0',
    )


def test_a_group_without_a_completed_lap_has_no_error() -> None:
    """The error of the stretch before the lane was lost does not count."""
    runs = Runs(laps=[lap(0, 0.3, completed=False)])
    assert [row[5] for row in table(runs, "Results against the paper's").rows] == ['none'] * 2
    [row] = table(runs, 'Laps').rows
    assert row[4] == '0 of 1 (0% to 79%)'
    assert row[5:10] == ('none', '—', 'none', '—', 'none')


def test_trainings_that_have_not_settled_are_censored(training: Train) -> None:
    """Their last lane loss is only the last one so far: neither dropped nor counted as final."""
    runs = Runs(
        trainings=[training(0, 8000, True), training(1, 9000, True), training(2, 8500, False)]
    )
    [row] = table(runs, "Results against the paper's").rows
    assert row[0] == 'step of the last lane loss'
    assert row[4:9] == (
        'about 10,000',
        '—',
        '9,000 (8,000 to 9,000)',  # 2/3 go on after 8,000, and none of those known after 9,000
        '—',
        '2 of 3 trainings',
    )
    [row] = table(runs, 'Trainings').rows
    assert row[3:] == (
        *('30,000', '3 (2 to 3)', '9,000 (8,000 to 9,000)', '—'),
        *('2 of 3', '0 to 2'),
    )


def test_laps_of_one_training_are_one_draw() -> None:
    """Three laps of either lane of two trainings: one training loses the lane once."""
    laps = [
        dataclasses.replace(
            lap(seed, error_m, completed=(training, seed, lane) != ('b', 2, 'inner'), lane=lane),
            training=training,
        )
        for training, error_m in (('a', 0.02), ('b', 0.04))
        for lane in ('outer', 'inner')
        for seed in (1, 2, 3)
    ]
    [row] = table(Runs(laps=laps), 'Success with learning off').rows
    # Wilson's of 1 of 2.
    assert row[3:] == ('training', 'outer, inner', '6', '1 of 2 (9% to 91%)', '1 to 3')
    outer, inner = table(Runs(laps=laps), 'Laps').rows
    assert (outer[4], outer[10]) == ('6 of 6 (34% to 100%)', '2 trainings')
    assert inner[4].startswith('5 of 6 (')
    # 12.7062 * 0.01 / 0.03 = 4.23540, and 0.03 * e^4.23540 = 2.0727.
    assert outer[5] == inner[5] == '0.0300 ± 0.0141 m (0.0004 to 2.0727)'


def test_seeds_that_gave_the_same_drive_are_one_draw() -> None:
    """A greedy policy without noise gives such drives."""
    same = lap(0, 0.03)
    laps = [same, *(dataclasses.replace(same, seed=seed) for seed in (1, 2))]
    [row] = table(Runs(laps=laps), 'Laps').rows
    assert row[4:6] == ('1 of 1 (21% to 100%)', '0.0300 m')
    assert row[10:] == ('1 seed', '0 to 2')


def test_settings_are_not_laid_together(transfer: Transfer) -> None:
    """Each has a row of its own."""
    other = dataclasses.replace(transfer(1, 0.9), setting='steps 20000')
    usual = transfer(1, 0.935)
    rows = table(Runs(transfers=[other, usual]), "Results against the paper's").rows
    assert [row[3:6] for row in rows] == [
        ("the paper's", '93.05 %', '93.50 %'),
        ('steps 20000', '93.05 %', '90.00 %'),
    ]


@pytest.mark.parametrize(
    ('seeds', 'words'),
    [([3], '3'), ([2, 0, 1], '0 to 2'), ([0, 7, 1, 9], '0 to 1, 7, 9'), ([4, 4], '4')],
)
def test_seeds_are_told_in_few_words(seeds: list[int], words: str) -> None:
    """Those in a row as a range."""
    assert seeds_in_words(seeds) == words


def test_the_papers_values_are_of_what_is_measured() -> None:
    """Each stands once, and has its place in the paper."""
    measured = {'last_lane_loss_step', 'solved_episode', 'accuracy', *(m[0] for m in LAP_MEASURES)}
    papers = {name: each.paper for name, each in cards().items() if each.paper}
    assert sorted(papers, key=lambda name: papers[name].order) == [
        'dqn',
        'dqn_snn',
        'braitenberg',
        'rstdp',
    ]
    for paper in papers.values():
        keys = [each[:2] for each in paper.values]
        assert len(set(keys)) == len(keys)
        for each in paper.values:
            assert each.scenario in ('1', '2', '3')
            assert each.measure in measured
            assert each.place
    accuracy = paper_value('dqn_snn', '2', 'accuracy')
    assert accuracy is not None
    assert accuracy.value == 0.9171
    assert paper_value('braitenberg', '2', 'accuracy') is None


def test_transfers_have_accuracies_and_rates(transfer: Transfer) -> None:
    """The s of 0.94 and 0.92 is 0.014142; on a logit scale half 12.7062 * 0.01 / 0.0651."""
    [row] = table(Runs(transfers=[transfer(0, 0.94), transfer(1, 0.92)]), 'Transfers').rows
    assert row == (
        'DQN-SNN',
        '1',
        "the paper's",
        '50,000',
        '93.00 ± 1.41 % (65.36 to 98.94)',
        '96.00 ± 0.00 % (96.00 to 96.00)',
        '50.00 ± 0.00 % (50.00 to 50.00)',
        '90.00 ± 0.00 % (90.00 to 90.00)',
        '0.2500 ± 0.0000 (0.2500 to 0.2500)',
        '0.0100 ± 0.0000 (0.0100 to 0.0100)',
        '0 to 1',
    )


def counted(controller: str, **operations: int) -> Lap:
    """Make a lap of 99 steps, 5 s with the observation at its reset, with its operations."""
    one = lap(0, 0.03)
    fields = {**dict.fromkeys(Operations._fields, 0), **operations}
    metrics = {**one.metrics, 'steps': 99, 'operations': fields}
    return dataclasses.replace(one, controller=controller, metrics=metrics)


def test_operations_are_counted_for_a_decision_and_a_second() -> None:
    """The two laps last 10 s; a lap without counts is left out."""
    spiking = counted('rstdp', decisions=100, synaptic=500)
    deep = counted(
        'dqn',
        decisions=10,
        multiply_accumulates=8000,
        active_inputs=70,
        active_multiply_accumulates=3000,
    )
    runs = Runs(laps=[spiking, spiking, deep, lap(7, 0.03)])
    of_deep, of_spiking = table(runs, 'Operations for a decision').rows
    assert of_spiking == ('R-STDP', '1', "the paper's", '20', '5', '—', '100', '—', '2')
    assert of_deep == (
        *('DQN', '1', "the paper's", '2'),
        *('—', '800 (300)', '—', '1,600 (600)', '1'),
    )


def test_numbers_in_settings_are_ordered_by_value() -> None:
    """50 before 100."""
    laps = [
        dataclasses.replace(lap(0, 0.03), setting=f'latency_ms {number}')
        for number in (100, 50, 200)
    ]
    settings = [key.setting for key in by_key(laps)]
    assert settings == ['latency_ms 50', 'latency_ms 100', 'latency_ms 200']


def kept(seed: int, training: str, lane: str, furthest_m: float, completed: bool = True) -> Lap:
    """Make a lap of R-STDP that strayed so far."""
    metrics = {**lap(seed, 0.01, completed).metrics, 'max_abs_distance_m': furthest_m}
    config = {'simulator': {'episode.max_distance_m': 0.5}}
    found: Lap = run_of(
        Lap, 'rstdp', seed, metrics=metrics, lane=lane, training=training, config=config
    )
    return found


def test_a_lap_that_strays_farther_than_trainings_may_is_not_kept() -> None:
    """R-STDP is reset at 0.2 m; Wilson's interval of 1 of 2 is from 9 % to 91 %."""
    laps = [
        *(kept(seed, 'runs/a', 'outer', 0.2) for seed in (7, 8)),
        *(kept(seed, 'runs/b', 'inner', 0.1 * seed) for seed in (1, 3)),
    ]
    [row] = table(Runs(laps=laps), 'Lanes kept with learning off').rows
    assert row == (
        'R-STDP',
        '1',
        "the paper's",
        '0.2 m',
        '3 of 4',
        'training',
        '1 of 2 (9% to 91%)',
    )
    # A lap of the deep Q-network ends where its trainings are reset.
    titles = [each.title for each in all_tables(Runs(laps=[lap(0, 0.03)]))]
    assert 'Lanes kept with learning off' not in titles


def test_aims_are_told_from_the_whole_interval(training: Train, transfer: Transfer) -> None:
    """The aims are on the card; a median needs six values, and 0.94 ± 0.0014 meets 93.1 %."""
    trainings = [training(seed, 8000 + seed, True) for seed in range(6)]
    transfers = [transfer(seed, 0.94 + seed * 0.001) for seed in range(3)]
    rows = table(Runs(trainings=trainings, transfers=transfers), 'Aims').rows
    steps, accuracy = sorted(rows, reverse=True)
    assert steps[:5] == (
        *('R-STDP', '1', "the paper's"),
        *('step of the last lane loss: median', '≤ 9,000'),
    )
    assert steps[5].startswith('8,00')
    assert steps[6] == 'yes'
    # s = 0.001 and half = 4.302653 * 0.001 / sqrt(3) / (0.941 * 0.059) = 0.04474 on a logit scale.
    assert accuracy[3:] == (
        *("accuracy on the policy's states: mean", '≥ 93.10 %'),
        *('93.85 to 94.34 %', 'yes'),
    )
    [few] = table(Runs(trainings=trainings[:5]), 'Aims').rows
    assert few[5:] == ('—', 'too few to tell')
    late = [training(seed, 9000 + 1000 * (seed % 2), True) for seed in range(6)]
    assert table(Runs(trainings=late), 'Aims').rows[0][6] == 'no'


def test_every_seed_has_its_values(training: Train) -> None:
    """A lap counts as one of the training that it drove with."""
    runs = Runs(
        trainings=[
            dataclasses.replace(
                training(seed, 8000 + seed, settled),
                folder=Path(f'runs/train-{seed}'),
                metrics={'wall_time_s': 90.0},
            )
            for seed, settled in ((3, True), (4, False))
        ],
        laps=[
            kept(1003, 'moved/train-3', 'outer', 0.1),
            kept(1004, 'moved/train-4', 'outer', 0.1),
            kept(1005, 'moved/train-4', 'outer', 0.6, completed=False),
        ],
    )
    assert [row[3:] for row in table(runs, 'Every seed').rows] == [
        ('step of the last lane loss', '3: 8,003; 4: over 8,004'),
        ('wall time', '3: 1.5 min; 4: 1.5 min'),
        ('mean error, outer lane', '3: 0.0100 m; 4: 0.0100 m (1 of 2 lost)'),
    ]


def test_laps_under_difficulties_are_counted() -> None:
    """A row for each value and a column for each controller."""

    def group(noise_hz: float, completed: int, error_m: float | None) -> dict[str, Any]:
        simulator = {'pixels.model': 'coppelia', 'pixels.coppelia.noise_rate_hz': noise_hz}
        error = None if error_m is None else {'mean': error_m}
        shares = {'successes': completed, 'n': 10}
        laps = {'unit': 'seed', 'completed': shares, 'mean_abs_distance_m': error}
        return {'controller': 'rstdp', 'simulator': simulator, 'laps': {'all': laps}}

    results = {'name': 'x', 'groups': [group(0.1, 0, None), group(0.0, 10, 0.00482)]}
    found = table(
        Runs(conditions=[Conditions(Path('runs/x'), results)]), 'Laps under difficulties: runs/x'
    )
    assert found.header == ('difficulty', 'R-STDP')
    assert found.rows == [
        ('noise rate of a pixel [Hz]: 0', '10 of 10, 0.0048 m'),
        ('noise rate of a pixel [Hz]: 0.1', '0 of 10'),
    ]
