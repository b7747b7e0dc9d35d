"""The `spikelane` command: help, wrong use and exit codes."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
import signal
import sys
from types import ModuleType

import pytest

from spikelane.executables import executables, find_executable
from spikelane.interruption import check
from spikelane.main import COMMANDS, main, run
from spikelane_controllers import registry
from spikelane_sim.errors import PacketError, SpikelaneError


def exit_of(*arguments: str) -> object:
    """Run the command to its end; return the exit code."""
    with pytest.raises(SystemExit) as end:
        main(arguments)
    return end.value.code


def fake_command(monkeypatch: pytest.MonkeyPatch, result: BaseException | int) -> None:
    """Put a command in the place of `lap` that ends with that."""

    def run_fake(options: argparse.Namespace) -> int:
        del options
        if isinstance(result, BaseException):
            raise result
        return result

    module = ModuleType('spikelane.runs.lap.command')
    module.add_arguments = lambda parser: None  # type: ignore[attr-defined]
    module.run = run_fake  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, 'spikelane.runs.lap.command', module)


def install_recorder(prefix: Path) -> None:
    """Make a prefix with the package `spikelane` and its recorder in it."""
    for name in ('share/ament_index/resource_index/packages/spikelane', 'lib/spikelane/recorder'):
        (prefix / name).parent.mkdir(parents=True)
        (prefix / name).touch()


def test_help_lists_the_commands(capsys: pytest.CaptureFixture[str]) -> None:
    """Each with its purpose."""
    assert exit_of('--help') == 0
    text = capsys.readouterr().out
    for name, purpose in COMMANDS.items():
        assert name in text
        assert purpose in text


def test_help_on_a_lap_has_every_option(capsys: pytest.CaptureFixture[str]) -> None:
    """With its default."""
    assert exit_of('lap', '--help') == 0
    text = ' '.join(capsys.readouterr().out.split())
    for option in (
        '--scenario', '--controller', '--lane', '--seed', '--transport', '--robot',
        '--pixels', '--antialias', '--param', '--out', '--json',
    ):  # fmt: skip
        assert f'{option} ' in text
    for default in ('1', 'braitenberg', "the course's first, outer", '0', 'ros', 'pybullet'):
        assert f'(default: {default})' in text


@pytest.mark.parametrize('command', COMMANDS)
def test_every_command_has_a_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    """It begins with how to call it."""
    assert exit_of(command, '--help') == 0
    assert capsys.readouterr().out.startswith(f'usage: spikelane {command} ')


@pytest.mark.parametrize(
    ('arguments', 'error'),
    [
        ([], 'spikelane: the following arguments are required: COMMAND'),
        (['fly'], "spikelane: argument COMMAND: invalid choice: 'fly' (choose from "),
        (['lap', '--fly'], 'spikelane: unrecognized arguments: --fly'),
        (['lap', '--seed', 'x'], "spikelane lap: argument --seed: invalid int value: 'x'"),
        (
            ['lap', '--robot', 'x'],
            'spikelane lap: argument --robot: robot.model: expected one of p3dx',
        ),
        (['node', 'x'], 'spikelane node: node: expected one of simulator, braitenberg, '),
        (['node'], 'spikelane node: the following arguments are required: NODE'),
    ],
)
def test_wrong_use_is_told_in_one_line(
    arguments: list[str], error: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2, nothing on the standard output."""
    assert exit_of(*arguments) == 2
    out, err = capsys.readouterr()
    assert (out, err.count('\n')) == ('', 1)
    assert err.startswith(error)


@pytest.mark.parametrize('status', [0, 1])
def test_the_exit_code_is_the_commands(monkeypatch: pytest.MonkeyPatch, status: int) -> None:
    """Done, or failed."""
    fake_command(monkeypatch, status)
    assert exit_of('lap') == status


@pytest.mark.parametrize(
    ('error', 'status'), [(SpikelaneError('no such lane'), 2), (PacketError('no such lane'), 1)]
)
def test_an_error_is_told_in_one_line(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    error: SpikelaneError,
    status: int,
) -> None:
    """Its own exit code says whose fault it was."""
    fake_command(monkeypatch, error)
    assert run(['lap']) == status
    assert capsys.readouterr() == ('', 'spikelane lap: no such lane\n')


def test_a_package_that_names_its_controller_wrongly_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """In one line, as every command that knows the controllers fails."""
    installed = tmp_path / 'my_package-1.0.dist-info'
    installed.mkdir()
    (installed / 'METADATA').write_text('Metadata-Version: 2.1\nName: my-package\nVersion: 1.0\n')
    (installed / 'entry_points.txt').write_text('[spikelane.controllers]\nMine = mine:Mine\n')
    monkeypatch.syspath_prepend(tmp_path)
    registry._entries.cache_clear()
    try:
        assert run(['lap']) == 2
    finally:
        registry._entries.cache_clear()
    assert capsys.readouterr() == (
        '',
        'spikelane lap: spikelane.controllers: expected a name of a-z, 0-9 and _ that no other '
        "package has, got 'Mine' of package my_package\n",
    )


def test_a_bug_is_no_wrong_use(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its traceback is for us."""
    fake_command(monkeypatch, ZeroDivisionError())
    with pytest.raises(ZeroDivisionError):
        run(['lap'])


@pytest.mark.parametrize(('number', 'status'), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_takes_effect_between_two_steps(
    monkeypatch: pytest.MonkeyPatch, number: int, status: int
) -> None:
    """As shells have it: 128 + n; the step is finished, and the clean-up is not cut short."""
    done = []

    def run_until_told(options: argparse.Namespace) -> int:
        del options
        try:
            signal.raise_signal(number)
            done.append('step')
            check()
            done.append('next step')
        finally:
            signal.raise_signal(number)
            check()
            done.append('clean-up')
        return 0

    fake_command(monkeypatch, 0)
    monkeypatch.setattr(sys.modules['spikelane.runs.lap.command'], 'run', run_until_told)
    assert run(['lap']) == status
    assert done == ['step', 'clean-up']


def test_a_node_is_found_through_the_ament_index(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """In the first prefix that has its package, as `ros2 run` does."""
    monkeypatch.setenv('AMENT_PREFIX_PATH', f':{tmp_path}/a:{tmp_path}/b b:{tmp_path}/c')
    for prefix in ('b b', 'c'):
        install_recorder(tmp_path / prefix)
    assert find_executable('recorder') == tmp_path / 'b b/lib/spikelane/recorder'
    with pytest.raises(
        SpikelaneError, match='expected package spikelane_sim in AMENT_PREFIX_PATH'
    ):
        find_executable('simulator')


def test_a_node_becomes_the_process(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """With all arguments that follow its name, ours or not."""
    install_recorder(tmp_path)
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    called = []
    monkeypatch.setattr(os, 'execv', lambda *call: called.append(call) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        run(['node', 'recorder', '--ros-args', '-p', 'output:=bag', '--help'])
    program = str(tmp_path / 'lib/spikelane/recorder')
    assert called == [(program, [program, '--ros-args', '-p', 'output:=bag', '--help'])]


def test_without_ros_no_node_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """One line says what to do."""
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    for name in executables():
        with pytest.raises(SpikelaneError, match=f'node {name}: .* source install/setup.bash'):
            find_executable(name)


@pytest.mark.parametrize('command', [['lap'], ['train', 'rstdp'], ['evaluate']])
@pytest.mark.parametrize(
    ('missing', 'error'),
    [
        ('spikelane_msgs', '--transport ros: expected ROS 2 and the built workspace, got '),
        ('', 'node simulator: expected package spikelane_sim in AMENT_PREFIX_PATH'),
    ],
)
def test_where_nodes_cannot_be_started_no_folder_is_made(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    command: list[str],
    missing: str,
    error: str,
) -> None:
    """The same command can go there once they can."""
    if missing:
        for module in ('spikelane_msgs', 'spikelane_msgs.srv'):
            monkeypatch.setitem(sys.modules, module, None)
        monkeypatch.delitem(sys.modules, 'spikelane.runs.lap.nodes.driving', raising=False)
    else:
        pytest.importorskip('spikelane_msgs')
        monkeypatch.delenv('AMENT_PREFIX_PATH')
    out = tmp_path / 'run'
    assert run([*command, '--transport', 'ros', '--out', str(out)]) == 2
    assert capsys.readouterr().err.startswith(f'spikelane {command[0]}: {error}')
    assert not out.exists()


@pytest.mark.parametrize(
    ('options', 'error'),
    [
        ('--controller rstdp --train --checkpoint x', '--checkpoint, --lane: expected no --train'),
        ('--controller rstdp --train --lane inner', '--checkpoint, --lane: expected no --train'),
        ('--controller rstdp --steps 100', '--steps: expected together with --train'),
        ('--steps 100', '--steps: expected together with --train'),
    ],
)
def test_what_a_view_would_not_heed_is_refused(
    capsys: pytest.CaptureFixture[str], options: str, error: str
) -> None:
    """Before anything is shown."""
    assert run(['view', *options.split()]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count('\n')) == ('', 1)
    assert err.startswith(f'spikelane view: {error}')


def test_the_version_is_that_of_the_project(capsys: pytest.CaptureFixture[str]) -> None:
    """Which is in pyproject.toml."""
    with pytest.raises(SystemExit, match='0'):
        run(['--version'])
    assert capsys.readouterr().out == 'spikelane 0.1.0\n'
