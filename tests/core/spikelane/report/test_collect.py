"""What is found in folders of runs, and what is said of the rest."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from spikelane.report.collect import collect, ReportError
from spikelane.report.runs import LeftOut, TrainingRun
from spikelane_controllers.checkpoint import write_checkpoint
from spikelane_controllers.dqn.results import DqnResults

METRICS = {
    'completed': True,
    'steps': 4000,
    'lap_time_s': 200.0,
    'mean_abs_distance_m': 0.02,
    'max_abs_distance_m': 0.1,
    'mean_distance_m': 0.01,
}


def write_lap(folder: Path, **others: Any) -> Path:
    """Write what a report needs of a lap's folder; others than the usual values by name."""
    config = {'scenario': '1', 'controller': 'braitenberg', 'seed': 4, 'lane': 'outer', **others}
    folder.mkdir(parents=True)
    (folder / 'config.yaml').write_text(yaml.safe_dump(config, sort_keys=False))
    (folder / 'metrics.json').write_text(json.dumps(METRICS))
    return folder


def write_training(
    folder: Path, seed: int, ends: list[list[Any]], controller: str = 'rstdp', **config: Any
) -> Path:
    """Write the checkpoint of a training, and nothing else."""
    folder.mkdir(parents=True)
    facts = {
        'config': {'scenario': '2', 'controller': controller, 'seed': seed, **config},
        'steps': 9000,
        'terminations': ends,
        'outcomes': [],
        'controller': {'updates': 0},
    }
    write_checkpoint(folder / 'checkpoint.safetensors', controller, {'a': np.zeros(2)}, facts)
    return folder


def test_runs_are_found_however_deep_and_once(tmp_path: Path) -> None:
    """In the order of their names, whatever folders they are asked for in."""
    write_lap(tmp_path / 'b/c/lap')
    write_lap(tmp_path / 'a', seed=5)
    found = collect([tmp_path, tmp_path / 'b'])
    assert [(lap.seed, lap.folder) for lap in found.laps] == [
        (5, tmp_path / 'a'),
        (4, tmp_path / 'b/c/lap'),
    ]
    assert len(found) == 2
    assert found.left_out == []


def test_a_setting_is_what_differs_from_the_paper(tmp_path: Path) -> None:
    """Not where and with which weights file; and nothing that this version lacks."""
    simulator = {
        'course': 'scenario_1',
        'episode.max_laps': 3,
        'robot.model': 'kinematic',
        'camera.antialias': True,
        'camera.pitch_deg': 30.0,
        'of.another_version': 1,
    }
    write_lap(tmp_path / 'lap', simulator=simulator, braitenberg={'poisson.max_rate_hz': 400.0})
    [lap] = collect([tmp_path]).laps
    assert lap.setting == (
        'episode.max_laps 3; robot.engine kinematic; camera.antialias True; '
        'poisson.max_rate_hz 400.0'
    )


def test_a_changed_urdf_is_another_setting(tmp_path: Path) -> None:
    """Also of the weights; where a checkpoint has no digest, it is not known to be another."""
    urdf = str(tmp_path / 'own.urdf')
    digests = {'a': {urdf: 'ab12cd34' + 56 * '0'}, 'b': {urdf: 'ef56ab78' + 56 * '0'}, 'c': {}}
    common = {'simulator': {'robot.model': urdf}, 'save_every': 100}
    weights = {
        name: write_training(tmp_path / name, 0, [], inputs=inputs, **common)
        for name, inputs in digests.items()
    }
    for seed, (name, checkpoint) in enumerate(weights.items()):
        learnt = {'controller': 'rstdp', 'rstdp': {'checkpoint': str(checkpoint)}}
        simulator = {'robot.model': urdf}
        write_lap(
            tmp_path / f'lap_{name}',
            scenario='2',
            seed=seed,
            simulator=simulator,
            inputs=digests['a'],
            **learnt,
        )
    own = f'robot.model {urdf} (SHA-256 ab12cd34)'
    found = collect([tmp_path])
    assert {run.folder.name: run.setting for run in found.laps} == {
        'lap_a': own,
        'lap_b': f'{own}; learnt with robot.model {urdf} (SHA-256 ef56ab78)',
        'lap_c': own,
    }
    assert [run.setting for run in found.trainings] == [
        own,
        f'robot.model {urdf} (SHA-256 ef56ab78)',
        f'robot.model {urdf}',
    ]


def test_filters_are_a_setting(tmp_path: Path) -> None:
    """Those that differ from their defaults; a run without filters has none."""
    write_lap(tmp_path / 'a', filter={'chain': 'correlation', 'correlation.supporters': 3})
    write_lap(tmp_path / 'b')
    found = {lap.folder.name: lap.setting for lap in collect([tmp_path]).laps}
    assert found == {'a': 'filter.chain correlation; filter.correlation.supporters 3', 'b': ''}


def test_how_episodes_end_is_told_against_what_is_usual(tmp_path: Path) -> None:
    """The usual distance differs in a training, the usual number of steps in a transfer."""
    weights = write_training(
        tmp_path / 'a',
        0,
        [],
        simulator={'episode.max_distance_m': 0.2, 'episode.max_laps': 1},
        save_every=100,
    )
    write_training(
        tmp_path / 'b', 0, [], simulator={'episode.max_distance_m': 0.4}, save_every=100
    )
    learnt = {'controller': 'rstdp', 'rstdp': {'checkpoint': str(weights)}}
    write_lap(tmp_path / 'c', scenario='2', simulator={'episode.max_steps': 100}, **learnt)
    found = collect([tmp_path])
    assert [run.setting for run in found.trainings] == ['', 'episode.max_distance_m 0.4']
    assert [run.setting for run in found.laps] == ['episode.max_steps 100']
    assert [run.learnt_steps for run in found.all()] == [9000, 9000, 9000]


def write_transfer(folder: Path, checkpoint: str, **config: Any) -> Path:
    """Write what a report needs of a transfer's folder."""
    folder.mkdir()
    values = {'scenario': '1', 'seed': 0, 'checkpoint': checkpoint, 'transfer': {}, **config}
    (folder / 'config.yaml').write_text(yaml.safe_dump(values))
    metrics = {'accuracy': 1.0, 'training_accuracy': 1.0, 'states': 1, 'maximum': 1, 'rates': {}}
    (folder / 'metrics.json').write_text(json.dumps(metrics))
    facts = {'config': values, 'curve': []}
    write_checkpoint(folder / 'checkpoint.safetensors', 'dqn_snn', {'a': np.zeros(2)}, facts)
    return folder


def test_a_transfers_training_is_part_of_its_setting(tmp_path: Path) -> None:
    """And of laps with what was transferred; also where the experiment's folder was moved."""
    trained = tmp_path / 'train'
    trained.mkdir()
    config = {'scenario': '1', 'controller': 'dqn', 'seed': 0, 'save_every': 1000}
    config['dqn'] = {'network.initial_bound': 0.001}
    facts = {
        'config': config,
        'steps': 500,
        'terminations': [],
        'outcomes': [],
        'controller': {'updates': 0},
    }
    write_checkpoint(trained / 'checkpoint.safetensors', 'dqn', {'a': np.zeros(2)}, facts)
    (trained / 'run.json').write_text('{}')
    moved = write_transfer(tmp_path / 'transfer', '/elsewhere/train')
    write_lap(tmp_path / 'lap', controller='dqn_snn', dqn_snn={'checkpoint': str(moved)})
    found = collect([tmp_path])
    assert [(run.setting, run.learnt_steps) for run in (*found.transfers, *found.laps)] == [
        ('learnt with network.initial_bound 0.001', 500),
        ('learnt with network.initial_bound 0.001', 500),
    ]


def test_transfers_with_other_states_are_not_laid_together(tmp_path: Path) -> None:
    """Most states were met in the training."""
    for name, is_used in (('with', True), ('without', False)):
        write_transfer(tmp_path / name, 'scenario_1', from_training=is_used)
    assert [run.setting for run in collect([tmp_path]).transfers] == ['', 'from_training False']


def test_a_broken_evaluation_counts_for_nothing(tmp_path: Path) -> None:
    """Not even the laps before the one that is broken."""
    write_lap(tmp_path / 'lap')
    folder = write_lap(tmp_path / 'evaluation', lane=None, evaluation={})
    (folder / 'metrics.json').write_text('{"laps": [{"course": "1"}, {"course": "1"}]}')
    for name, row in (('a', {'course': '1', 'lane': 'outer', 'seed': 3, **METRICS}), ('b', {})):
        (folder / 'laps' / name).mkdir(parents=True)
        (folder / 'laps' / name / 'metrics.json').write_text(json.dumps(row))
    found = collect([tmp_path])
    assert [lap.folder.name for lap in found.laps] == ['lap']
    assert [each.what for each in found.left_out] == [str(folder)]


def test_a_file_is_never_a_scenario_of_the_paper(tmp_path: Path) -> None:
    """Whatever its name; courses of one name in two folders are two."""
    courses = ('2', 'scenario_3', 'mine/scenario_1.yaml', '1.yaml', 'a/track.yaml', 'b/track.yaml')
    for number, course in enumerate(courses):
        write_lap(tmp_path / str(number), scenario=course)
    assert [lap.scenario for lap in collect([tmp_path]).laps] == ['2', '3', *courses[2:]]


def test_how_something_learns_is_part_of_a_setting(tmp_path: Path) -> None:
    """And so is a lap's learning, which changes the weights on the way."""
    write_transfer(tmp_path / 'transfer', 'scenario_1', transfer={'learning_rate': 0.001})
    write_lap(tmp_path / 'lap', controller='rstdp', rstdp={'learning': True})
    found = collect([tmp_path])
    assert [run.setting for run in found.transfers] == ['learning_rate 0.001']
    assert [run.setting for run in found.laps] == ['learning True']


def test_weights_learnt_otherwise_are_another_setting(tmp_path: Path) -> None:
    """Laps with them are not laid together with the others."""
    weights = write_training(tmp_path / 'training', 0, [], rstdp={'c_r': 0.03})
    learnt = {'controller': 'rstdp', 'rstdp': {'c_r': 0.01, 'checkpoint': str(weights)}}
    write_lap(tmp_path / 'lap', **learnt)
    write_lap(tmp_path / 'moved', controller='rstdp', rstdp={'checkpoint': '/nowhere'})
    settings = [lap.setting for lap in collect([tmp_path]).laps]
    assert settings == ['learnt with c_r 0.03; learnt in scenario 2', 'weights of /nowhere']


def test_a_training_is_read_from_its_checkpoint_alone(tmp_path: Path) -> None:
    """It has settled if both lanes were lapped after the last was lost."""
    lost = [4000, 1, 'outer', 'B', 6.0, 0.21, 4000, 'lane_lost']
    laps = [
        [6000, 2, 'inner', 'C', 0.4, 0.0, 2000, 'laps_complete'],
        [8500, 3, 'outer', 'A', 0.5, 0.0, 2500, 'laps_complete'],
    ]
    write_training(tmp_path / '0', 0, [lost, *laps])
    write_training(tmp_path / '1', 1, [laps[0], lost, laps[1]])
    first, second = collect([tmp_path]).trainings
    settled, unsettled = first.results, second.results
    assert (first.scenario, first.seed, settled.steps) == ('2', 0, 9000)
    assert (settled.last_lane_loss_step, settled.has_settled) == (4000, True)
    assert [end.lane for end in settled.terminations] == ['outer', 'inner', 'outer']
    assert unsettled.has_settled is True  # its inner lap ended at step 6000, after 4000
    one_lane = write_training(tmp_path / '2', 2, [laps[0], [*[7000], *lost[1:]], laps[1]])
    [half] = collect([one_lane]).trainings
    assert (half.results.last_lane_loss_step, half.results.has_settled) == (7000, False)
    # On a course of one lane, twice.
    once, twice = ([lost, *[laps[1]] * number] for number in (1, 2))
    [run] = collect([write_training(tmp_path / '3', 3, once)]).trainings
    assert run.results.has_settled is False
    [run] = collect([write_training(tmp_path / '4', 4, twice)]).trainings
    assert run.results.has_settled is True


def solved(run: TrainingRun) -> tuple[Any, Any]:
    """Return the number of the first episode, and the step at the last one's end."""
    results = run.results
    assert isinstance(results, DqnResults)
    return results.solved_episode, results.solved_step


def test_a_dqn_training_is_solved_by_three_full_episodes(tmp_path: Path) -> None:
    """In a row, on both lanes: here those from the second episode on."""
    names = ['lane_lost', 'step_limit', 'step_limit', 'step_limit', 'lane_lost']
    ends = [
        [1000 * n, n, ('inner', 'outer')[n % 2], 'A', 1.0, 0.0, 1000, reason]
        for n, reason in enumerate(names, 1)
    ]
    [run] = collect([write_training(tmp_path / '0', 0, ends, 'dqn')]).trainings
    assert solved(run) == (2, 4000)
    of_one_lane = [[*end[:2], 'outer', *end[3:]] for end in ends]
    [run] = collect([write_training(tmp_path / '2', 0, of_one_lane, 'dqn')]).trainings
    assert solved(run) == (2, 4000)
    [never] = collect([write_training(tmp_path / '1', 0, ends[:3], 'dqn')]).trainings
    assert solved(never) == (None, None)


def test_what_cannot_be_used_is_named(tmp_path: Path) -> None:
    """These are unfinished, damaged and failed runs; all other runs are used."""
    write_lap(tmp_path / 'a')
    (write_lap(tmp_path / 'b') / 'metrics.json').unlink()
    (write_lap(tmp_path / 'c') / 'config.yaml').write_text('[')
    write_lap(tmp_path / 'd', controller='fly')
    (write_lap(tmp_path / 'e', training=None) / 'metrics.json').unlink()
    (write_lap(tmp_path / 'f') / 'metrics.json').write_text('{"completed": true}')
    (tmp_path / 'results.json').write_text(
        json.dumps(
            {
                'runs': [
                    {'name': 'x', 'state': 'failed', 'message': 'no such course', 'folder': None},
                    {'name': 'y', 'state': 'blocked', 'message': 'needs x', 'folder': None},
                    {'name': 'z', 'state': 'waiting', 'message': '', 'folder': None},
                    {'name': 'b', 'state': 'waiting', 'message': '', 'folder': 'b'},
                ]
            }
        )
    )
    found = collect([tmp_path])
    assert [lap.folder for lap in found.laps] == [tmp_path / 'a']
    assert LeftOut(f'{tmp_path}: x', 'no such course') in found.left_out
    assert (
        LeftOut(str(tmp_path / 'b'), 'the run has not finished: metrics.json is missing')
        in found.left_out
    )
    why = 'metrics.json: steps: expected a whole number, got none: is the file of another version?'
    assert LeftOut(str(tmp_path / 'f'), why) in found.left_out
    assert [each.what for each in found.left_out] == [
        f'{tmp_path}: x',
        f'{tmp_path}: y',
        f'{tmp_path}: 1 of 4 runs',
        str(tmp_path / 'b'),
        *(str(tmp_path / name) for name in 'cdef'),
    ]


def test_runs_whose_places_others_took_are_left_out(tmp_path: Path) -> None:
    """A run that the results do not name yet counts, and so does a lap that somebody added."""
    names = {'a': 'a', 'a-2': 'a', 'b': 'b', 'b-2': 'b', 'new': 'new', 'own': None}
    for seed, (folder, name) in enumerate(names.items()):
        write_lap(tmp_path / folder, seed=seed)
        if name is not None:
            (tmp_path / folder / 'run.json').write_text(json.dumps({'name': name}))
    listed = [
        {'name': 'a', 'state': 'done', 'message': '', 'folder': 'a-2'},
        {'name': 'b', 'state': 'found', 'message': '', 'folder': 'b'},
    ]
    (tmp_path / 'results.json').write_text(json.dumps({'runs': listed}))
    found = collect([tmp_path])
    assert [lap.folder.name for lap in found.laps] == ['a-2', 'b', 'new', 'own']
    why = 'the experiment was changed after they were made, and other runs took their places'
    assert found.left_out == [LeftOut(f'{tmp_path}: 2 runs', why)]


def test_an_unfinished_training_says_how_far_it_is(tmp_path: Path) -> None:
    """By its checkpoint; it is in no table, as it would be a training of fewer steps."""
    folder = write_training(tmp_path / 'a', 0, [])
    config = {'scenario': '2', 'controller': 'rstdp', 'seed': 0, 'training': {'steps': 20_000}}
    (folder / 'config.yaml').write_text(yaml.safe_dump(config))
    write_lap(tmp_path / 'b')
    found = collect([tmp_path])
    why = 'the run has not finished: metrics.json is missing, at step 9,000 of 20,000'
    assert (found.trainings, found.left_out) == ([], [LeftOut(str(folder), why)])


def test_a_copy_of_a_run_counts_once(tmp_path: Path) -> None:
    """The same seed, setting and outcome; another outcome of the same seed is another run."""
    write_lap(tmp_path / 'a')
    write_lap(tmp_path / 'b')
    other = write_lap(tmp_path / 'c')
    (other / 'metrics.json').write_text(json.dumps({**METRICS, 'mean_abs_distance_m': 0.03}))
    end = [4000, 1, 'outer', 'B', 6.0, 0.21, 4000, 'lane_lost']
    write_training(tmp_path / 'd', 0, [end])
    write_training(tmp_path / 'e', 0, [end])
    write_training(tmp_path / 'f', 1, [end])
    found = collect([tmp_path])
    assert [lap.folder.name for lap in found.laps] == ['a', 'c']
    assert [run.folder.name for run in found.trainings] == ['d', 'f']
    assert found.left_out == [
        LeftOut(str(tmp_path / 'b'), f'it is a copy of {tmp_path}/a, and a run counts once'),
        LeftOut(str(tmp_path / 'e'), f'it is a copy of {tmp_path}/d, and a run counts once'),
    ]


def test_laps_of_many_random_courses_are_one_group(tmp_path: Path) -> None:
    """On one course alone they are that course's, whatever scenario the controller is for."""
    for name, courses in (('many', ['random:3', 'random:4']), ('one', ['scenario_2'])):
        folder = tmp_path / name
        rows = [
            {**METRICS, 'course': course, 'lane': 'outer', 'seed': 0, 'steps': number}
            for number, course in enumerate(courses)
        ]
        for row in rows:
            lap = folder / 'laps' / f'{row["course"]}-outer'
            lap.mkdir(parents=True)
            (lap / 'metrics.json').write_text(json.dumps(row))
        config = {'scenario': '1', 'controller': 'braitenberg', 'seed': 0}
        config['evaluation'] = {'seeds': 1, 'lanes': [], 'courses': courses}
        (folder / 'config.yaml').write_text(yaml.safe_dump(config))
        (folder / 'metrics.json').write_text(json.dumps({'laps': rows}))
    laps = collect([tmp_path]).laps
    assert [(lap.scenario, lap.config['scenario']) for lap in laps] == [
        ('random courses', 'random:3'),
        ('random courses', 'random:4'),
        ('2', 'scenario_2'),
    ]


def test_the_results_of_conditions_are_kept(tmp_path: Path) -> None:
    """For the figure of robustness; an experiment without conditions has none."""
    write_lap(tmp_path / 'a/run')
    for name, condition in (('a', 'noise-0.1'), ('b', '')):
        (tmp_path / name).mkdir(exist_ok=True)
        results = {'name': name, 'runs': [], 'groups': [{'conditions': condition}]}
        (tmp_path / name / 'results.json').write_text(json.dumps(results))
    [found] = collect([tmp_path]).conditions
    assert (found.folder, found.results['name']) == (tmp_path / 'a', 'a')


def test_nothing_to_report_on_is_wrong_use(tmp_path: Path) -> None:
    """No such folder, or no run in it."""
    with pytest.raises(ReportError, match=r'none: expected a folder of runs, got none'):
        collect([tmp_path / 'none'])
    with pytest.raises(ReportError, match='expected finished runs, got none'):
        collect([tmp_path])
