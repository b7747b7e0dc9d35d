"""`spikelane lap` in-process: what it prints, what it leaves, what it refuses."""

from __future__ import annotations

import contextlib
import io
import json
import os
from pathlib import Path
import re
import subprocess
import sys
from typing import Any, NamedTuple

import pytest
import yaml

from spikelane.main import _parser, run
from spikelane.runs.arguments import given_parameters
from spikelane.runs.configuration import Request
from spikelane.runs.lap.config import LapConfig
from spikelane.runs.lap.run import drive_lap
from spikelane.runs.lap.trajectory import read_csv
from spikelane_sim.errors import ParameterError, SpikelaneError

KINEMATIC = ('lap', '--transport', 'inprocess', '--robot', 'kinematic')
SHORT = ('--param', 'simulator.episode.max_steps=40')


class Lap(NamedTuple):
    """What came of a lap."""

    status: int
    result: dict[str, Any]
    folder: Path


@pytest.fixture(scope='module')
def lap(tmp_path_factory: pytest.TempPathFactory) -> Lap:
    """Drive the outer lane of scenario 1, a whole lap."""
    folder = tmp_path_factory.mktemp('lap') / 'with space'
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        status = run([*KINEMATIC, '--seed', '3', '--out', str(folder), '--json'])
    return Lap(status, json.loads(printed.getvalue()), folder)


def drive(out: Path, *arguments: str) -> int:
    """Drive a lap of two seconds."""
    return run([*KINEMATIC, *SHORT, '--out', str(out), *arguments])


def test_the_robot_completes_the_outer_lane(lap: Lap) -> None:
    """On its event camera alone, in about 5,000 steps as in the paper."""
    assert lap.status == 0
    assert lap.result['completed'] is True
    assert (lap.result['reason'], lap.result['laps']) == ('laps_complete', 1)
    # 31.99 m at 1.0 to 1.5 rad/s, which is 4.875 to 7.3125 mm a step.
    assert 4375 <= lap.result['steps'] <= 6563
    assert lap.result['lap_time_s'] == pytest.approx(lap.result['steps'] * 0.05)


def test_the_result_has_all_fields(lap: Lap) -> None:
    """It has at least these fields, and the options as they were given."""
    asked = {
        'scenario': '1',
        'controller': 'braitenberg',
        'lane': 'outer',
        'seed': 3,
        'transport': 'inprocess',
        'robot': 'p3dx',
        'engine': 'kinematic',
        'bag': None,
        'folder': str(lap.folder),
        'figure': str(lap.folder / 'figures/lap.svg'),
    }
    assert asked.items() <= lap.result.items()
    assert 0 < lap.result['mean_abs_distance_m'] <= lap.result['max_abs_distance_m'] < 0.5
    assert abs(lap.result['mean_distance_m']) <= lap.result['mean_abs_distance_m']
    assert lap.result['steps_per_s'] > 0
    assert lap.result['events'] > 0
    assert list(lap.result['sections']) == ['A', 'B', 'C', 'D', 'E', 'F']


def test_the_folder_has_all_files_of_a_run(lap: Lap) -> None:
    """And no others: nothing half written."""
    files = {str(path.relative_to(lap.folder)) for path in lap.folder.rglob('*') if path.is_file()}
    assert files == {
        'config.yaml',
        'trajectory.csv',
        'metrics.json',
        'figures/lap.svg',
        'figures/lap.png',
    }
    assert json.loads((lap.folder / 'metrics.json').read_text()) == lap.result


def test_the_result_can_be_computed_from_the_trajectory(lap: Lap) -> None:
    """One row per observation, the one at the reset included."""
    trajectory = read_csv(lap.folder / 'trajectory.csv')
    steps = lap.result['steps']
    assert trajectory.step.tolist() == list(range(steps + 1))
    assert trajectory.stamp_ns.tolist() == [50_000_000 * (n + 1) for n in range(steps + 1)]
    distances = trajectory.distance_m[1:].tolist()
    mean_m = sum(map(abs, distances)) / steps
    assert lap.result['mean_abs_distance_m'] == pytest.approx(mean_m, abs=1e-12)
    assert lap.result['max_abs_distance_m'] == max(map(abs, distances))
    assert lap.result['mean_distance_m'] == pytest.approx(sum(distances) / steps, abs=1e-12)
    assert lap.result['events'] == sum(trajectory.events.tolist())
    assert trajectory.progress_m[-1] >= 31.991148575128552 > trajectory.progress_m[-2]


def test_the_configuration_drives_the_same_lap(lap: Lap) -> None:
    """Everything that determines it is there, with the seed and versions."""
    config = yaml.safe_load((lap.folder / 'config.yaml').read_text())
    head = ('scenario', 'controller', 'lane', 'seed', 'transport')
    assert [config[key] for key in head] == ['1', 'braitenberg', 'outer', 3, 'inprocess']
    assert config['simulator']['robot.engine'] == 'kinematic'
    assert config['versions']['python'] == '.'.join(map(str, sys.version_info[:3]))
    parameters = {
        f'{group}.{name}': value
        for group in ('simulator', 'braitenberg')
        for name, value in config[group].items()
    }
    again = LapConfig.make(Request('1', 'braitenberg', 3, 'inprocess', parameters), 'outer')
    assert again.to_dict().items() <= config.items()


def test_a_seed_gives_the_same_bytes(tmp_path: Path) -> None:
    """Another one gives others, since the controller's spikes are drawn."""
    assert drive(tmp_path / 'a', '--seed', '5') == 1
    assert drive(tmp_path / 'b', '--seed', '5') == 1
    assert drive(tmp_path / 'c', '--seed', '6') == 1
    a, b, c = ((tmp_path / name / 'trajectory.csv').read_bytes() for name in 'abc')
    assert a == b
    assert a != c


def test_a_lap_that_is_not_completed_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All results are there nevertheless, as lines of text."""
    assert drive(tmp_path / 'lap', '--lane', 'inner', '--scenario', '2') == 1
    out, err = capsys.readouterr()
    lines = dict(line.split(maxsplit=1) for line in out.splitlines() if line.count(' ') > 1)
    assert out.startswith('lap completed   no, step_limit\nsteps           40, ')
    assert lines['bag'] == 'none (in-process)'
    assert lines['figure'] == str(tmp_path / 'lap/figures/lap.svg')
    assert err == ''
    assert json.loads((tmp_path / 'lap/metrics.json').read_text())['lane'] == 'inner'


def test_progress_is_shown_on_a_terminal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On one line that ends before the results."""
    terminal = io.StringIO()
    monkeypatch.setattr(terminal, 'isatty', lambda: True, raising=False)
    monkeypatch.setattr(sys, 'stderr', terminal)
    drive(tmp_path / 'lap')
    assert terminal.getvalue() == '\r     0 steps,   0.0 m \n'


def test_the_usual_folders_are_numbered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No run is ever written over."""
    monkeypatch.chdir(tmp_path)
    for _ in range(2):
        assert run([*KINEMATIC, *SHORT]) == 1
    name = 'lap-1-braitenberg-outer-seed0'
    assert sorted(path.name for path in (tmp_path / 'runs').iterdir()) == [name, f'{name}-2']


@pytest.mark.parametrize(
    ('arguments', 'error'),
    [
        (
            ('--scenario', '4'),
            'course: expected scenario_1, scenario_2, scenario_3, random:',
        ),
        (('--scenario', 'nowhere.yaml'), "course: expected scenario_1, .* got 'nowhere.yaml'"),
        (('--lane', 'middle'), "lane: expected outer or inner, got 'middle'"),
        (('--seed', '-1'), r'seed: expected a whole number from 0 to 2\^63 - 1, got -1'),
        (('--seed', str(2**63)), 'seed: expected a whole number from 0 to'),
        (('--param', 'fov=1'), "unknown parameter 'fov'; expected simulator.<name> or braitenb"),
        (('--param', 'fov'), "--param: expected NAME=VALUE, got 'fov'"),
        (('--param', 'simulator.fov=1'), "simulator: unknown parameter 'fov'; expected period_ms"),
        (('--param', 'simulator.camera.fov_deg=[1'), 'simulator.camera.fov_deg: expected a value'),
        (
            ('--param', 'simulator.course=2024-13-01'),
            "simulator.course: expected a value as in YAML, got '2024-13-01'",
        ),
        (
            ('--param', 'simulator.camera.fov_deg=wide'),
            "simulator: camera.fov_deg: expected a number from 1 to 170 deg, got 'wide'",
        ),
        (
            ('--param', 'simulator.camera.width=64'),
            'simulator.camera.width, simulator.camera.height: expected 128 x 128 px, which '
            'braitenberg is made for, got 64 x 128 px',
        ),
        (
            ('--controller', 'rstdp', '--checkpoint', '/nowhere'),
            "checkpoint: expected one of scenario_1, .* got '/nowhere'",
        ),
    ],
)
def test_wrong_use_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], error: str
) -> None:
    """Exit code 2, and nothing is left."""
    assert drive(tmp_path / 'lap', *arguments) == 2
    out, err = capsys.readouterr()
    assert (out, err.count('\n')) == ('', 1)
    assert re.match(f'spikelane lap: {error}', err)
    assert not (tmp_path / 'lap').exists()


def test_another_image_goes_with_a_controller_that_is_made_for_it() -> None:
    """Both sizes are set."""
    sizes = {'simulator.camera.width': 64, 'dqn.image.width': 64}
    assert LapConfig.make(Request('1', 'dqn', 0, 'inprocess', sizes)).simulator.camera.width == 64
    with pytest.raises(SpikelaneError, match=r'expected 64 x 128 px, .* got 128 x 128 px'):
        LapConfig.make(Request('1', 'dqn', 0, 'inprocess', {'dqn.image.width': 64}))


def test_an_unknown_controller_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By the command line already."""
    with pytest.raises(SystemExit) as end:
        drive(tmp_path / 'lap', '--controller', 'nobody')
    assert end.value.code == 2
    _, err = capsys.readouterr()
    assert err.count('\n') == 1
    assert "--controller: invalid choice: 'nobody' (choose from" in err
    with pytest.raises(SpikelaneError, match='controller: expected one of braitenberg'):
        LapConfig.make(Request('1', 'nobody', 0, 'inprocess', {}))


def test_a_folder_in_use_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What is in it stays as it is."""
    (tmp_path / 'mine').write_text('precious')
    assert drive(tmp_path) == 2
    _, err = capsys.readouterr()
    assert err == f'spikelane lap: {tmp_path}: expected a new or empty folder, got one in use\n'
    assert [path.name for path in tmp_path.iterdir()] == ['mine']


@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('90', 90),
        ('1e-3', 0.001),
        ('-2E5', -200000.0),
        ('.5e1', 5.0),
        ('1.0e-3', 0.001),
        ('true', True),
        ('e1', 'e1'),
        ('a=b', 'a=b'),
        ('[1, 2.5]', [1, 2.5]),
    ],
)
def test_a_parameter_on_the_command_line_is_yaml(text: str, value: object) -> None:
    """But for powers of ten, which people write without a point."""
    options = _parser(['lap']).parse_args(['lap', '--param', f'simulator.x={text}'])
    parameters = given_parameters(options)
    assert parameters == {'simulator.x': value}
    assert type(parameters['simulator.x']) is type(value)


def test_options_are_short_forgiven_parameters() -> None:
    """An option wins over the parameter; what is not given is not set."""
    line = ['lap', '--robot', 'kinematic', '--pixels', 'esim', '--no-antialias']
    line += ['--param', 'simulator.robot.model=pybullet']
    assert given_parameters(_parser(line).parse_args(line)) == {
        'simulator.robot.model': 'kinematic',
        'simulator.pixels.model': 'esim',
        'simulator.camera.antialias': False,
    }


def test_the_robot_in_pybullet_prints_one_line_of_json(tmp_path: Path) -> None:
    """The engine prints messages, but not on standard output."""
    ended = subprocess.run(
        [sys.executable, '-m', 'spikelane.main', 'lap', '--transport', 'inprocess']
        + ['--robot', 'pybullet', '--json', '--out', str(tmp_path / 'lap'), *SHORT],
        env=os.environ | {'PYTHONPATH': os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (ended.returncode, ended.stdout.count('\n')) == (1, 1)
    result = json.loads(ended.stdout)
    assert (result['engine'], result['steps']) == ('pybullet', 40)


def test_the_controller_has_the_control_period_of_the_simulator() -> None:
    """Its limits of steps last as long as usual: 30 s without progress are 3000 of 10 ms."""
    asked = Request('1', 'rstdp', parameters={'simulator.period_ms': 10})
    config = LapConfig.make(asked)
    assert config.controller_parameters.to_dict()['period_ms'] == 10
    assert config.simulator.episode.no_progress_steps == 3000
    usual = LapConfig.make(Request('1', 'rstdp'))
    assert config.simulator.episode.max_steps == pytest.approx(
        5 * usual.simulator.episode.max_steps, abs=5
    )


def test_a_controller_with_another_period_is_refused() -> None:
    """One sentence says both."""
    expected = 'period_ms: expected 10 ms for the controller, as simulator.period_ms, got 20'
    periods = {'simulator.period_ms': 10, 'rstdp.period_ms': 20}
    with pytest.raises(ParameterError, match=expected):
        LapConfig.make(Request('1', 'rstdp', parameters=periods))


def test_a_lap_in_short_steps_takes_as_long() -> None:
    """In simulated time; the robot is where it is, 0.1 s are ten steps of 10 ms."""
    periods = {'simulator.period_ms': 10, 'simulator.robot.engine': 'kinematic'}
    limit = {'simulator.episode.max_steps': 200}
    config = LapConfig.make(Request('1', 'rstdp', 3, parameters=periods | limit))
    trajectory = drive_lap(config, lambda *_: None).trajectory
    assert trajectory.period_s == 0.01
    assert trajectory.stamp_ns.tolist() == [10_000_000 * (n + 1) for n in range(201)]
    # 2 s at 1.0 to 1.5 rad/s of wheels of 0.0975 m
    assert 0.195 < trajectory.progress_m[-1] < 0.293
