"""Presets of real event cameras."""

import json
from pathlib import Path

import pytest

from spikelane.main import run
from spikelane_sim.errors import ParameterError
from spikelane_sim.sensor_preset import load_preset, preset_names, preset_parameters
from spikelane_sim.simulator_parameters import SimulatorParameters


def test_the_presets_are_those_of_the_cameras() -> None:
    """They have the cameras' sizes, and name the source of each value."""
    sizes = {}
    for name in preset_names():
        preset = load_preset(name)
        sizes[name] = preset['width'], preset['height']
        made = SimulatorParameters.from_mapping(preset_parameters(preset))
        assert (made.pixels.model, made.camera.antialias) == ('esim', True)
        assert all(len(each['source']) > 5 for each in preset['values'].values())
    assert sizes == {
        'davis346': (346, 260),
        'davis346_dim': (346, 260),
        'dvs128': (128, 128),
        'dvxplorer': (640, 480),
        'imx636': (1280, 720),
        'v2e_clean': (128, 128),
        'v2e_noisy': (128, 128),
    }


def test_v2es_presets_have_its_values() -> None:
    """They come from set_dvs_params; its bandwidth is only a remark, as it is not simulated."""
    noisy = load_preset('v2e_noisy')
    esim = SimulatorParameters.from_mapping(preset_parameters(noisy)).pixels.esim
    assert (esim.threshold_on, esim.threshold_off, esim.threshold_spread) == (0.2, 0.2, 0.05)
    assert (esim.leak_rate_hz, esim.shot_rate_hz, esim.refractory_s) == (0.1, 5.0, 0.0)
    assert any('30 Hz' in remark for remark in noisy['remarks'])


def test_a_preset_comes_before_other_parameters(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A file is as good as a name; the run's configuration has what came of it."""
    file = tmp_path / 'mine.yaml'
    file.write_text(
        'title: Mine\nwidth: 10\nheight: 10\nremarks: []\nvalues:\n'
        '  pixels.model: {value: esim, basis: assumed, source: nothing}\n'
        '  pixels.esim.threshold_on: {value: 0.3, basis: assumed, source: nothing}\n'
        '  pixels.esim.shot_rate_hz: {value: 2.0, basis: assumed, source: nothing}\n'
    )
    common = ['lap', '--transport', 'inprocess', '--engine', 'kinematic', '--json']
    limit = ['--param', 'simulator.episode.max_steps=3']
    own = ['--preset', str(file), '--param', 'simulator.pixels.esim.shot_rate_hz=4.0']
    assert run([*common, *limit, *own, '--out', str(tmp_path / 'lap')]) == 1
    assert json.loads(capsys.readouterr().out)['steps'] == 3
    config = (tmp_path / 'lap/config.yaml').read_text()
    for line in ('pixels.model: esim', 'threshold_on: 0.3', 'shot_rate_hz: 4.0'):
        assert line in config


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('title: x', r'height: expected|width: expected|values: expected'),
        (
            'title: x\nwidth: 1\nheight: 1\nremarks: []\nvalues:\n'
            '  pixels.esim.bandwidth: {value: 1, basis: assumed, source: y}',
            "unknown parameter 'pixels.esim.bandwidth'",
        ),
        (
            'title: x\nwidth: 1\nheight: 1\nremarks: []\nvalues:\n'
            '  pixels.model: {value: esim, basis: rumour, source: y}',
            'values.pixels.model.basis: expected one of read, measured, quoted, assumed',
        ),
    ],
)
def test_a_file_that_is_no_preset_is_refused(tmp_path: Path, text: str, reason: str) -> None:
    """The message names the file."""
    file = tmp_path / 'mine.yaml'
    file.write_text(text)
    with pytest.raises(ParameterError, match=f'mine.yaml: .*({reason})'):
        load_preset(str(file))


def test_an_unknown_name_is_refused_with_those_there_are() -> None:
    """A word without an ending is a name."""
    with pytest.raises(ParameterError, match=r"expected one of davis346, .*, got 'davis240'"):
        load_preset('davis240')


def test_the_page_has_the_presets_values() -> None:
    """A row each: size, thresholds, noise."""
    page = (Path(__file__).parents[3] / 'docs/sensors.md').read_text('utf-8')
    for name in preset_names():
        preset = load_preset(name)
        [row] = [line for line in page.splitlines() if line.startswith(f'| `{name}` |')]
        assert f'{preset["width"]} x {preset["height"]}' in row
        for key in ('threshold_on', 'threshold_off', 'threshold_spread', 'shot_rate_hz'):
            assert f'{preset["values"][f"pixels.esim.{key}"]["value"]:g}' in row
