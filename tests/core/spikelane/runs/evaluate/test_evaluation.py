"""Evaluations: which laps they drive, what they make of them, and going on with one."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import pytest
import yaml

from spikelane.fleet import setting
from spikelane.lock import locked
from spikelane.main import run
from spikelane.runs.configuration import Request
from spikelane.runs.evaluate.config import EvaluateConfig
from spikelane.runs.evaluate.metrics import evaluation_metrics
from spikelane.runs.evaluate.run import evaluate
from spikelane.runs.folder import RunFolder
from spikelane.runs.lap import run as lap
from spikelane.runs.lap.config import LapConfig
from spikelane.runs.lap.metrics import lap_metrics
import spikelane_sim.course
from spikelane_sim.errors import SpikelaneError

#: A robot in a file.
SMALL = Path(__file__).parents[5] / 'docs/examples/robot/small.urdf'

SHORT: dict[str, Any] = {
    'simulator.robot.model': 'kinematic',
    'simulator.episode.max_steps': 60,
    'simulator.link.event_loss': 0.2,
}


def config_of(evaluation: dict[str, Any], seed: int = 0, scenario: str = '1') -> EvaluateConfig:
    """Make the configuration of an evaluation of short drives."""
    return EvaluateConfig.make(
        Request(scenario, 'braitenberg', seed, 'inprocess', SHORT), evaluation
    )


def evaluate_in(path: Path, config: EvaluateConfig) -> dict[str, Any]:
    """Evaluate in a folder."""
    return evaluate(config, RunFolder(path), lambda steps, share: None)


def row(lane: str, seed: int, completed: bool, error_m: float) -> dict[str, Any]:
    """Return what is known of a lap."""
    values = dict.fromkeys(
        ('max_abs_distance_m', 'mean_distance_m', 'std_distance_m', 'mean_speed_m_s'), 1.0
    )
    return {
        'course': '1',
        'lane': lane,
        'seed': seed,
        'completed': completed,
        'mean_abs_distance_m': error_m,
        'lap_time_s': 200.0 if completed else None,
        'progress_m': 32.0 if completed else 4.0,
        **values,
    }


def test_the_laps_are_those_of_each_course_lane_and_seed() -> None:
    """In an order that is always the same; of several courses each has its number."""
    laps = list(config_of({'seeds': 2}, seed=5).laps())
    assert [each.name for each in laps] == [
        'outer-seed5',
        'outer-seed6',
        'inner-seed5',
        'inner-seed6',
    ]
    laps = list(config_of({'lanes': ['inner'], 'courses': ['3', '1']}).laps())
    assert [each.name for each in laps] == ['001-3-inner-seed0', '002-1-inner-seed0']
    assert [each.config.simulator.course for each in laps] == ['scenario_3', 'scenario_1']


def test_a_course_or_lane_named_twice_is_driven_once() -> None:
    """Also where ranges of random courses overlap."""
    named = ['random:2', '3', 'random:1-2', '3']
    laps = config_of({'lanes': ['inner', 'outer', 'inner'], 'courses': named}).laps()
    assert [each.name for each in laps] == [
        '001-random-0-inner-seed0',
        '001-random-0-outer-seed0',
        '002-random-1-inner-seed0',
        '002-random-1-outer-seed0',
        '003-3-inner-seed0',
        '003-3-outer-seed0',
        '004-random-2-inner-seed0',
        '004-random-2-outer-seed0',
    ]


def test_each_lap_is_the_one_driven_alone(tmp_path: Path) -> None:
    """The same command with that lane and seed gives the same numbers."""
    metrics = evaluate_in(tmp_path, config_of({'seeds': 2}, seed=7))
    assert len(metrics['laps']) == 4
    assert len({each['events'] for each in metrics['laps']}) > 1
    config = LapConfig.make(Request('1', 'braitenberg', 8, 'inprocess', SHORT), 'inner')
    alone = lap.drive_lap(config, lambda step, progress_m: None).trajectory
    found = metrics['laps'][3]
    expected = {'course': '1', 'lane': 'inner', 'seed': 8, **lap_metrics(alone, 0.05)}
    also = {'progress_m': None, 'operations': None}
    assert {**found, **also} == {**expected, **also}
    assert found['progress_m'] == alone.progress_m[-1] > 0.1


def test_means_are_of_completed_laps_and_progress_of_all() -> None:
    """A lap that ends early says nothing about the rest."""
    rows = [
        row('outer', 0, True, 0.02),
        row('outer', 1, True, 0.04),
        row('inner', 0, False, 0.4),
        row('inner', 1, True, 0.06),
    ]
    summary = evaluation_metrics(config_of({'seeds': 2}), rows)['summary']
    assert set(summary) == {'all', 'by_lane'}
    error = summary['all']['mean_abs_distance_m']
    # Seed 0 has one completed lap, seed 1 has two: (0.02 + 0.05) / 2.
    assert (error['n'], error['units'], error['mean']) == (3, 2, pytest.approx(0.035))
    assert (summary['all']['unit'], summary['all']['units']) == ('seed', 2)
    assert summary['all']['completed']['share'] == 0.75
    assert summary['all']['progress_m']['mean'] == 25.0
    inner = summary['by_lane']['inner']
    assert inner['mean_abs_distance_m']['mean'] == 0.06
    assert (inner['completed']['successes'], inner['completed']['n']) == (1, 2)
    assert inner['lap_time_s']['n'] == 1


def test_where_no_lap_is_completed_there_are_no_means() -> None:
    """But a share of 0, with its interval."""
    summary = evaluation_metrics(config_of({}), [row('outer', 0, False, 0.4)])['summary']
    assert summary['all']['mean_abs_distance_m'] is None
    assert summary['all']['completed']['ci_high'] == pytest.approx(0.793451, abs=1e-6)


def test_several_courses_are_told_apart() -> None:
    """Each with its laps."""
    rows = [row('outer', 0, True, 0.02), {**row('outer', 0, True, 0.04), 'course': '3'}]
    summary = evaluation_metrics(config_of({'courses': ['1', '3']}), rows)['summary']
    errors = {
        course: group['mean_abs_distance_m']['mean']
        for course, group in summary['by_course'].items()
    }
    assert errors == {'1': 0.02, '3': 0.04}


def test_an_evaluation_that_was_stopped_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Laps that are there are not driven again; the result is that of one never stopped."""
    config = config_of({'seeds': 2})
    whole, stopped = tmp_path / 'whole', tmp_path / 'stopped'
    evaluate_in(whole, config)
    seen: list[int] = []

    def stop_in_third_lap(steps: int, share: float) -> None:
        seen.append(steps)
        if steps == 150:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evaluate(config, RunFolder(stopped), stop_in_third_lap)
    done = stopped / 'laps/outer-seed1/metrics.json'
    written = done.stat().st_mtime_ns
    assert not (stopped / 'metrics.json').exists()
    steps: list[int] = []
    evaluate(config, RunFolder(stopped), lambda number, share: steps.append(number))
    assert done.stat().st_mtime_ns == written
    assert (stopped / 'metrics.json').read_bytes() == (whole / 'metrics.json').read_bytes()
    assert steps[:3] == [60, 120, 120]


@pytest.mark.parametrize('is_together', [False, True])
def test_the_share_done_grows_to_one(
    tmp_path: Path, is_together: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Step by step, or lap by lap where the laps are driven together."""
    monkeypatch.setattr(setting, 'LEAST_STEPS', 0 if is_together else math.inf)
    shares: list[float] = []
    evaluate(config_of({}), RunFolder(tmp_path), lambda steps, share: shares.append(share))
    assert shares == sorted(shares)
    assert 0.0 <= shares[0] < 0.1
    assert shares[-1] == 1.0


def command(*options: str) -> int:
    """Run `spikelane evaluate` with the kinematic robot, 60 steps of each lap."""
    limit = 'simulator.episode.max_steps=60'
    return run(['evaluate', '--robot', 'kinematic', '--param', limit, *options])


def test_the_command_leaves_a_folder_and_goes_on_in_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its options are in the configuration; a different one does not go on."""
    out = tmp_path / 'run'
    given = ['--out', str(out), '--seeds', '2', '--lanes', 'outer', '--laps', '3', '--json']
    given += ['--latency-ms', '100', '--event-loss', '0.1', '--noise-hz', '0.5']
    assert command(*given) == 0
    result = json.loads(capsys.readouterr().out)
    assert result.pop('folder') == str(out)
    assert result == json.loads((out / 'metrics.json').read_text())
    assert (result['latency_ms'], result['event_loss'], result['seeds']) == (100, 0.1, 2)
    simulator = yaml.safe_load((out / 'config.yaml').read_text())['simulator']
    assert simulator['pixels.coppelia.noise_rate_hz'] == 0.5
    assert simulator['episode.max_laps'] == 3
    assert len((out / 'laps/outer-seed1/trajectory.csv').read_text().splitlines()) == 62
    assert command(*given, '--resume') == 0
    assert command(*given) == 2
    assert command(*given, '--seeds', '3', '--resume') == 2
    error = capsys.readouterr().err
    assert 'expected a run with evaluation.seeds 3, got one with 2' in error


def test_it_says_how_far_a_drive_came_that_is_not_complete(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A line for each of the first twenty; the lanes are 31.99 and 28.85 m long."""
    options = ['--robot', 'kinematic', '--param', 'simulator.episode.max_steps=20']
    out = ['--seeds', '11', '--laps', '2', '--out', str(tmp_path / 'out')]
    assert run(['evaluate', *options, *out]) == 0
    lines = capsys.readouterr().out.splitlines()
    laps = json.loads((tmp_path / 'out/metrics.json').read_text())['laps']
    expected = [
        f'           outer, seed {lap["seed"]}: step limit after {lap["progress_m"]:.1f} of 64.0 m'
        for lap in laps[:11]
    ]
    start = next(number for number, line in enumerate(lines) if 'seed 0' in line)
    assert lines[start : start + 11] == expected
    assert lines[start + 11].startswith('           inner, seed 0: step limit after 0.')
    assert lines[start + 11].endswith(' of 57.7 m')
    assert lines[start + 20] == '           and 2 more, in metrics.json'


def test_it_does_not_go_on_with_another_course_in_the_same_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Laps on both would be laid together."""
    course = tmp_path / 'mine.yaml'
    shipped = Path(spikelane_sim.course.__file__).parent / 'courses/scenario_1.yaml'
    course.write_text(shipped.read_text())
    given = ('--scenario', str(course), '--out', str(tmp_path / 'run'), '--lanes', 'outer')
    assert command(*given) == 0
    assert command(*given, '--resume') == 0
    course.write_text(shipped.read_text() + '# another')
    assert command(*given, '--resume') == 2
    assert f'expected a run with inputs.{course} ' in capsys.readouterr().err


def test_two_do_not_evaluate_in_one_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The other's laps stay as they are; who is at work there is said."""
    given = ('--out', str(tmp_path / 'run'), '--lanes', 'outer')
    assert command(*given) == 0
    capsys.readouterr()
    (tmp_path / 'run/laps/outer-seed0/metrics.json').unlink()
    with locked(tmp_path / 'run'):
        assert command(*given, '--resume') == 1
    error = f'{tmp_path / "run"}: another process works here: {os.getpid()}'
    assert capsys.readouterr().err == f'spikelane evaluate: {error}\n'
    assert (tmp_path / 'run/laps/outer-seed0/trajectory.csv').exists()


def test_weights_that_cannot_be_read_leave_no_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The same command with others can go there."""
    (tmp_path / 'weights').write_bytes(b'not these')
    given = ('--controller', 'rstdp', '--out', str(tmp_path / 'run'))
    assert command(*given, '--checkpoint', str(tmp_path / 'weights')) == 1
    error = f'spikelane evaluate: {tmp_path / "weights"}: expected a whole safetensors file'
    assert capsys.readouterr().err.startswith(error)
    assert not (tmp_path / 'run').exists()


@pytest.mark.parametrize('laps', ['0', '-1'])
def test_a_drive_without_end_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], laps: str
) -> None:
    """As a controller that keeps its lane would drive no laps in a row."""
    assert command('--laps', laps, '--out', str(tmp_path / 'run')) == 2
    error = f'spikelane evaluate: --laps: expected a whole number from 1 to 1000000, got {laps}\n'
    assert capsys.readouterr().err == error
    assert not (tmp_path / 'run').exists()


def test_noise_is_that_of_the_pixel_model(tmp_path: Path) -> None:
    """Each has its own parameter."""
    out = tmp_path / 'run'
    assert command('--pixels', 'esim', '--noise-hz', '2', '--out', str(out)) == 0
    simulator = yaml.safe_load((out / 'config.yaml').read_text())['simulator']
    assert simulator['pixels.esim.shot_rate_hz'] == 2.0
    assert simulator['pixels.coppelia.noise_rate_hz'] == 0.0


@pytest.mark.parametrize(
    ('evaluation', 'message'),
    [
        ({'seeds': 0}, 'evaluation: seeds: expected a whole number from 1'),
        ({'lanes': ['middle']}, "lane: expected outer or inner, got 'middle'"),
        ({'courses': ['9']}, 'course: expected .* or the path of a course file'),
    ],
)
def test_what_cannot_be_evaluated_is_refused_before_anything_is(
    evaluation: dict[str, Any], message: str
) -> None:
    """One line says why."""
    with pytest.raises(SpikelaneError, match=message):
        config_of(evaluation)


def test_a_robot_whose_urdf_has_changed_is_noticed(tmp_path: Path) -> None:
    """An evaluation is not resumed with another robot, whatever the file is called."""
    urdf = tmp_path / 'own.urdf'
    text = SMALL.read_text('utf-8')
    urdf.write_text(text, 'utf-8')
    own = {**SHORT, 'simulator.robot.engine': 'kinematic', 'simulator.robot.model': str(urdf)}
    config = EvaluateConfig.make(Request('1', 'braitenberg', 0, 'inprocess', own), {})
    folder = RunFolder.begin(config, tmp_path / 'run')
    config.check_resumable(folder)
    urdf.write_text(f'{text}<!-- changed -->', 'utf-8')
    with pytest.raises(SpikelaneError, match=r'expected a run with inputs\..*own\.urdf'):
        config.check_resumable(folder)
