"""`spikelane parameters`: the reference of any controller, also of one in another package."""

import json

import pytest

from spikelane.main import run


def test_a_controller_has_those_of_its_training_and_transfer(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Under the names that `--param` takes, with what is allowed and where it comes from."""
    assert run(['parameters', 'rstdp', '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert found['rstdp.c_r'] == {
        'default': 0.01,
        'allowed': 'a number from 0 to 1000000 1/(ms m)',
        'unit': '1/(ms m)',
        'description': 'Dopamine for each metre of distance from the lane centre.',
        'source': 'table "Simulation parameters specification"',
        'changes': 'next step',
    }
    assert found['training.steps']['default'] == 30000
    assert run(['parameters', 'dqn_snn', '--json']) == 0
    groups = {name.partition('.')[0] for name in json.loads(capsys.readouterr().out)}
    assert groups == {'dqn_snn', 'transfer', 'gathering'}
    assert run(['parameters', 'braitenberg', '--json']) == 0
    assert {name.partition('.')[0] for name in json.loads(capsys.readouterr().out)} == {
        'braitenberg'
    }


def test_the_page_is_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    """A row for each parameter, with as many cells as the header."""
    assert run(['parameters', 'simulator']) == 0
    title, _, header, rule, *rows = capsys.readouterr().out.splitlines()
    assert title == '# Parameters: simulator'
    assert header == '| parameter | default | allowed | meaning | source | changes from |'
    assert {row.replace(r'\|', '').count('|') for row in (header, rule, *rows)} == {7}
    [fov] = [row for row in rows if row.startswith('| `simulator.camera.fov_deg` |')]
    assert '| `100.0` | a number from 1 to 170 deg |' in fov
    [spread] = [row for row in rows if '`simulator.pixels.esim.threshold_spread`' in row]
    assert spread.endswith('| next episode |')


def test_an_unknown_name_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """With the names that there are."""
    with pytest.raises(SystemExit, match='2'):
        run(['parameters', 'camera'])
    assert "invalid choice: 'camera'" in capsys.readouterr().err
