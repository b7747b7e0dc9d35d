"""Plans: which runs an experiment has, and which of them are in a folder."""

from __future__ import annotations

from collections.abc import Sequence
import hashlib
from pathlib import Path

import numpy as np
import pytest

from spikelane.experiment.file import ExperimentError, read_experiment
from spikelane.experiment.plan import find_runs, make_plan, make_run_folder, Plan, PlannedRun
from spikelane_controllers.checkpoint import write_checkpoint
import spikelane_sim.course


def plan_of(folder: Path, matrix: str) -> Plan:
    """Make the plan of a file with this matrix."""
    file = folder / 'plan.yaml'
    file.write_text(f'name: tiny\nmatrix:\n{matrix}')
    return make_plan(read_experiment(file))


def lines(runs: Sequence[PlannedRun]) -> list[str]:
    """Return each run's name, and after which."""
    return [run.name + (f' < {run.before}' if run.before else '') for run in runs]


def named(plan: Plan, name: str) -> PlannedRun:
    """Return a run."""
    return next(run for run in plan.runs if run.name == name)


def test_a_block_stands_for_all_combinations(tmp_path: Path) -> None:
    """Who cannot learn is not trained; evaluations come after the training of the same place."""
    plan = plan_of(
        tmp_path,
        """
  controllers: [braitenberg, rstdp]
  scenarios: [2]
  seeds: [4, 7]
  cameras: {sharp: {}, smooth: {antialias: true}}
  tasks: {evaluate: {}, train: {steps: 100}}
""",
    )
    assert lines(plan.runs) == [
        'train-rstdp-2-sharp-seed4',
        'train-rstdp-2-sharp-seed7',
        'train-rstdp-2-smooth-seed4',
        'train-rstdp-2-smooth-seed7',
        'evaluate-braitenberg-2-sharp-seed4',
        'evaluate-braitenberg-2-sharp-seed7',
        'evaluate-braitenberg-2-smooth-seed4',
        'evaluate-braitenberg-2-smooth-seed7',
        'evaluate-rstdp-2-sharp-seed4 < train-rstdp-2-sharp-seed4',
        'evaluate-rstdp-2-sharp-seed7 < train-rstdp-2-sharp-seed7',
        'evaluate-rstdp-2-smooth-seed4 < train-rstdp-2-smooth-seed4',
        'evaluate-rstdp-2-smooth-seed7 < train-rstdp-2-smooth-seed7',
    ]
    config = named(plan, 'evaluate-rstdp-2-smooth-seed7').identity['configuration']
    assert config['simulator']['camera.antialias'] is True
    assert config['simulator']['course'] == 'scenario_2'
    assert config['seed'] == 7


def test_courses_and_conditions_are_of_evaluations_alone(tmp_path: Path) -> None:
    """One training serves them all."""
    plan = plan_of(
        tmp_path,
        """
  controllers: [rstdp]
  courses: [1, 3]
  conditions: {prompt: {}, late: {simulator.link.latency_ms: 100}}
  tasks: {train: {steps: 100}, evaluate: {seed_offset: 50, laps: 2}}
""",
    )
    assert lines(plan.runs) == [
        'train-rstdp-1-seed0',
        'evaluate-rstdp-1-1-prompt-seed0 < train-rstdp-1-seed0',
        'evaluate-rstdp-1-1-late-seed0 < train-rstdp-1-seed0',
        'evaluate-rstdp-1-3-prompt-seed0 < train-rstdp-1-seed0',
        'evaluate-rstdp-1-3-late-seed0 < train-rstdp-1-seed0',
    ]
    train, *_, last = (run.identity['configuration'] for run in plan.runs)
    assert train['simulator']['link.latency_ms'] == 0
    assert last['simulator']['link.latency_ms'] == 100
    assert last['evaluation']['courses'] == ['3']
    assert (last['seed'], last['simulator']['episode.max_laps']) == (50, 2)


def test_parameters_of_a_controller_are_not_given_to_others(tmp_path: Path) -> None:
    """Braitenberg has no c_r."""
    plan = plan_of(
        tmp_path,
        """
  controllers: [braitenberg, rstdp]
  variants: {slow: {rstdp.c_r: 0.005}}
  tasks: [evaluate]
""",
    )
    other, rstdp = (run.identity['configuration'] for run in plan.runs)
    assert 'rstdp' not in other
    assert rstdp['rstdp']['c_r'] == 0.005


def test_a_controller_that_is_not_trained_drives_with_shipped_weights(tmp_path: Path) -> None:
    """As `spikelane lap` has it."""
    plan = plan_of(tmp_path, '  {controllers: [rstdp], scenarios: [2], tasks: [evaluate]}')
    (run,) = plan.runs
    assert run.before is None
    assert run.identity['configuration']['rstdp']['checkpoint'] == 'scenario_2'


TWO_BLOCKS = """
  - controllers: [rstdp]
    seeds: 2
    variants: {A: {rstdp.c_r: 0.02}}
    tasks: {train: {steps: 100}}
  - controllers: [rstdp]
    seeds: 3
    variants: {B: {rstdp.c_r: 0.02}}
    tasks: [evaluate]
"""


def test_a_training_of_another_block_is_found_by_what_it_is(tmp_path: Path) -> None:
    """Not by its name; seed 2 was not trained."""
    assert lines(plan_of(tmp_path, TWO_BLOCKS).runs)[2:] == [
        'evaluate-rstdp-1-B-seed0 < train-rstdp-1-A-seed0',
        'evaluate-rstdp-1-B-seed1 < train-rstdp-1-A-seed1',
        'evaluate-rstdp-1-B-seed2',
    ]


def test_two_trainings_that_could_be_meant_are_refused(tmp_path: Path) -> None:
    """The evaluation has no name that would tell them apart."""
    text = TWO_BLOCKS + TWO_BLOCKS.replace('100', '200')
    with pytest.raises(ExperimentError, match=r'plan\.yaml:\d+: evaluate of rstdp: expected one'):
        plan_of(
            tmp_path,
            text + TWO_BLOCKS[TWO_BLOCKS.index('  - controllers: [rstdp]\n    seeds: 3') :],
        )


def test_the_same_run_is_there_once(tmp_path: Path) -> None:
    """A file may repeat it under any names; different runs of one name get a number."""
    plan = plan_of(
        tmp_path,
        """
  - {controllers: [rstdp], seeds: 2, tasks: {train: {steps: 100}}}
  - {controllers: [rstdp], seeds: 1, variants: {x: {}}, tasks: {train: {steps: 100}}}
  - {controllers: [rstdp], seeds: 1, tasks: {train: {steps: 200}}}
""",
    )
    assert lines(plan.runs) == [
        'train-rstdp-1-seed0',
        'train-rstdp-1-seed1',
        'train-rstdp-1-seed0-2',
    ]


def test_a_combination_that_is_not_allowed_is_refused_with_its_block(tmp_path: Path) -> None:
    """Before anything is driven."""
    with pytest.raises(
        ExperimentError, match=r'plan\.yaml:4: evaluate braitenberg: .*multiple of'
    ):
        plan_of(
            tmp_path,
            """
  - controllers: [braitenberg]
    variants: {late: {simulator.link.latency_ms: 70}}
    tasks: [evaluate]
""",
        )


TRANSFERS = """
  controllers: [dqn, dqn_snn]
  seeds: [4]
  robots: [kinematic]
  variants: {usual: {}, quicker: {transfer.learning_rate: 0.01, dqn_snn.encoding.frames: 10}}
  tasks: {train: {steps: 100}, transfer: {states: 50, steps: 30}, evaluate: {}}
"""


def test_a_transfer_comes_between_the_q_network_and_the_laps(tmp_path: Path) -> None:
    """All three have the same combination; parameters of the transfer do not add a training."""
    plan = plan_of(tmp_path, TRANSFERS)
    train, transfer = 'train-dqn-1-kinematic-usual-seed4', 'transfer-dqn_snn-1-kinematic'
    assert lines(plan.runs) == [
        train,
        f'{transfer}-usual-seed4 < {train}',
        f'{transfer}-quicker-seed4 < {train}',
        f'evaluate-dqn-1-kinematic-usual-seed4 < {train}',
        f'evaluate-dqn_snn-1-kinematic-usual-seed4 < {transfer}-usual-seed4',
        f'evaluate-dqn_snn-1-kinematic-quicker-seed4 < {transfer}-quicker-seed4',
    ]
    usual, quicker = (run.identity['configuration'] for run in plan.runs[1:3])
    assert usual['gathering']['states'] == quicker['gathering']['states'] == 50
    assert usual['transfer']['steps'] == quicker['transfer']['steps'] == 30
    assert [each['transfer']['learning_rate'] for each in (usual, quicker)] == [1e-4, 0.01]
    assert usual['simulator']['robot.engine'] == 'kinematic'
    assert (usual['seed'], usual['from_training']) == (4, True)
    drives = [run.identity['configuration']['dqn_snn'] for run in plan.runs[4:]]
    assert [each['encoding.frames'] for each in drives] == [1, 10]


def test_another_training_makes_another_transfer(tmp_path: Path) -> None:
    """It also makes other laps, although their own configuration is the same."""
    keys = [
        {run.name: run.key for run in plan_of(tmp_path, text).runs}
        for text in (TRANSFERS, TRANSFERS.replace('steps: 100', 'steps: 101'))
    ]
    assert keys[0].keys() == keys[1].keys()
    assert all(keys[0][name] != keys[1][name] for name in keys[0])


def test_a_transfer_without_a_training_is_refused(tmp_path: Path) -> None:
    """With what is missing."""
    with pytest.raises(
        ExperimentError,
        match=r'plan\.yaml:3: transfer of dqn_snn: expected train of dqn in the experiment too',
    ):
        plan_of(tmp_path, '  {controllers: [dqn_snn], tasks: [transfer, evaluate]}')


def test_a_policy_that_is_not_transferred_drives_with_shipped_weights(tmp_path: Path) -> None:
    """Even where its Q-network is trained."""
    plan = plan_of(
        tmp_path, '  {controllers: [dqn, dqn_snn], tasks: {train: {steps: 100}, evaluate: {}}}'
    )
    assert lines(plan.runs) == [
        'train-dqn-1-seed0',
        'evaluate-dqn-1-seed0 < train-dqn-1-seed0',
        'evaluate-dqn_snn-1-seed0',
    ]


def test_the_experiment_on_rstdp_has_twenty_trainings_and_laps_with_other_seeds() -> None:
    """As docs/results/rstdp.md has it; each training drives three seeds, each of them a lap."""
    root = Path(__file__).parents[4]
    plan = make_plan(read_experiment(root / 'experiments/rstdp.yaml'))
    trained = [run for run in plan.runs if run.task == 'train']
    assert {
        (
            run.labels['variants'],
            run.point.scenario,
            run.identity['configuration']['training']['steps'],
        )
        for run in trained
    } == {
        ('paper', '1', 30_000),
        ('paper', '2', 40_000),
        ('paper', '3', 120_000),
        ('best', '1', 30_000),
        ('best', '2', 30_000),
        ('best', '3', 30_000),
        ('c_r_0.03', '3', 30_000),
    }
    assert len(trained) == 140
    evaluated = [run.identity['configuration'] for run in plan.runs if run.task == 'evaluate']
    assert sorted(each['seed'] for each in evaluated) == sorted([*range(1000, 1020)] * 7)
    for each in evaluated:
        assert each['evaluation']['seeds'] == 3
        assert each['simulator']['episode.max_laps'] == 1
    assert {each['simulator']['robot.engine'] for each in evaluated} == {'pybullet'}


SMALL = '  {controllers: [rstdp], VARIANT tasks: {train: {steps: STEPS}, evaluate: {}}}'


def test_runs_are_found_by_their_configuration(tmp_path: Path) -> None:
    """Also under another name, or in a folder that was renamed; not with another step."""
    plan = plan_of(tmp_path, SMALL.replace('VARIANT', '').replace('STEPS', '100'))
    root = tmp_path / 'runs'
    train, evaluate = plan.runs
    folder = make_run_folder(root, train, None)
    make_run_folder(root, evaluate, folder)
    assert {name: found.is_finished for name, found in find_runs(root, plan.runs).items()} == {
        train.name: False,
        evaluate.name: False,
    }
    folder.write_metrics({})
    folder.path.rename(root / 'elsewhere')
    (root / 'broken').mkdir()
    (root / 'broken/run.json').write_text('{"identity":')
    other = plan_of(
        tmp_path, SMALL.replace('VARIANT', 'variants: {x: {}},').replace('STEPS', '100')
    )
    found = find_runs(root, other.runs)
    assert found['train-rstdp-1-x-seed0'].is_finished
    assert found['train-rstdp-1-x-seed0'].folder.path == root / 'elsewhere'
    assert not found['evaluate-rstdp-1-x-seed0'].is_finished
    # What is evaluated after another training is another evaluation.
    longer = plan_of(tmp_path, SMALL.replace('VARIANT', '').replace('STEPS', '101'))
    assert find_runs(root, longer.runs) == {}


def test_other_content_under_the_same_name_is_another_run(tmp_path: Path) -> None:
    """This holds for course files, and for weights that no run of the experiment has learnt."""
    course = tmp_path / 'mine.yaml'
    weights = tmp_path / 'weights'
    weights.mkdir()
    matrix = f"""
  controllers: [rstdp]
  scenarios: [{course}]
  variants: {{mine: {{rstdp.checkpoint: {weights}}}}}
  tasks: {{evaluate: {{}}}}
"""
    shipped = Path(spikelane_sim.course.__file__).parent / 'courses/scenario_1.yaml'
    keys = []
    for comment, learnt in (('', 1.0), ('# another', 1.0), ('', 2.0), ('', 1.0)):
        course.write_text(shipped.read_text() + comment)
        write_checkpoint(
            weights / 'checkpoint.safetensors', 'rstdp', {'a': np.ones(2) * learnt}, {}
        )
        [run] = plan_of(tmp_path, matrix).runs
        assert set(run.identity['inputs']) == {str(course), str(weights)}
        keys.append(run.key)
    assert keys[0] == keys[3]
    assert len(set(keys)) == 3
    digest = hashlib.sha256(course.read_bytes()).hexdigest()
    assert run.identity['inputs'][str(course)] == digest


def test_shipped_courses_and_weights_of_runs_have_no_digest(tmp_path: Path) -> None:
    """They are what they are called, or what the run before is."""
    matrix = """
  controllers: [rstdp]
  scenarios: [1]
  tasks: {train: {steps: 100}, evaluate: {}}
"""
    assert ['inputs' in run.identity for run in plan_of(tmp_path, matrix).runs] == [False, False]


def test_an_experiment_of_too_many_runs_is_refused_before_it_is_planned(tmp_path: Path) -> None:
    """The product of a block's lists is looked at first."""
    matrix = """
  controllers: [rstdp]
  scenarios: [1, 2, 3]
  seeds: 100000
  tasks: [train]
"""
    with pytest.raises(ExperimentError, match='at most 100000 runs in an experiment, got 300000'):
        plan_of(tmp_path, matrix)
