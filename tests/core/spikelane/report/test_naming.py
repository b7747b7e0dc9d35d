"""Long settings have names, which the page says once what they stand for."""

import dataclasses
import json
from pathlib import Path

from spikelane.report.collect import collect
from spikelane.report.naming import LONGEST, name_settings
from spikelane.report.runs import Lap, NamedSetting, Runs
from spikelane.report.tables import all_tables

LONG = 'poisson.max_events 30; camera.antialias True'
OTHER = 'poisson.max_events 30; camera.fov_deg 120'


def lap(controller: str, setting: str, folder: str = 'runs/lap') -> Lap:
    """Make a lap that was completed."""
    return Lap(
        controller=controller,
        scenario='1',
        seed=0,
        setting=setting,
        folder=Path(folder),
        config={},
        metrics={
            'completed': True,
            'steps': 5000,
            'mean_abs_distance_m': 0.01,
            'max_abs_distance_m': 0.1,
            'mean_distance_m': 0.0,
            'lap_time_s': 250.0,
        },
        lane='outer',
    )


def test_what_is_short_is_its_own_name() -> None:
    """The paper's setting has none."""
    assert min(len(LONG), len(OTHER)) > LONGEST
    runs = Runs(laps=[lap('rstdp', ''), lap('rstdp', 'c_r 0.03')])
    name_settings(runs)
    assert [each.setting for each in runs.laps] == ['', 'c_r 0.03']
    assert runs.settings == []


def test_weights_of_another_length_are_another_setting() -> None:
    """The length is named only if lengths differ, as the default depends on the scenario."""
    short, long = (
        dataclasses.replace(lap('rstdp', 'c_r 0.03'), learnt_steps=steps)
        for steps in (300, 30_000)
    )
    elsewhere = dataclasses.replace(short, scenario='2')
    runs = Runs(laps=[short, long, elsewhere, lap('rstdp', '')])
    name_settings(runs)
    assert [each.setting for each in runs.laps] == [
        'c_r 0.03; trained for 300 steps',
        'c_r 0.03; trained for 30,000 steps',
        'c_r 0.03',
        '',
    ]


def test_a_controllers_settings_are_numbered() -> None:
    """The same setting has the same name; another controller counts from one again."""
    settings = [('rstdp', LONG), ('rstdp', OTHER), ('rstdp', LONG), ('dqn', OTHER)]
    runs = Runs(laps=[lap(*each) for each in settings])
    name_settings(runs)
    assert [each.setting for each in runs.laps] == [
        'setting 1',
        'setting 2',
        'setting 1',
        'setting 1',
    ]
    assert runs.settings == [
        NamedSetting('rstdp', 'laps', 'setting 1', LONG),
        NamedSetting('rstdp', 'laps', 'setting 2', OTHER),
        NamedSetting('dqn', 'laps', 'setting 1', OTHER),
    ]
    [table] = [each for each in all_tables(runs) if each.title == 'Settings']
    assert table.rows == [
        ('DQN', 'laps', 'setting 1', OTHER),
        ('R-STDP', 'laps', 'setting 1', LONG),
        ('R-STDP', 'laps', 'setting 2', OTHER),
    ]


def test_an_experiments_variant_is_the_name() -> None:
    """It also names an evaluation's laps; if two settings share it, the second is numbered."""
    laps = [
        lap('rstdp', LONG, 'runs/x/evaluate-1/laps/1-outer-100'),
        lap('rstdp', OTHER, 'runs/x/evaluate-2/laps/1-outer-100'),
        lap('rstdp', 'best', 'runs/x/evaluate-3/laps/1-outer-100'),
    ]
    variants = {Path('runs/x/evaluate-1'): 'best', Path('runs/x/evaluate-2'): 'best'}
    runs = Runs(laps=laps[:2], variants=variants)
    name_settings(runs)
    assert [each.setting for each in runs.laps] == ['best', 'best 2']
    # What is called so already keeps its name.
    runs = Runs(laps=[laps[0], laps[2]], variants=variants)
    name_settings(runs)
    assert [each.setting for each in runs.laps] == ['best 2', 'best']


def test_variants_are_read_from_an_experiments_results(tmp_path: Path) -> None:
    """Those of runs that left a folder."""
    runs = [
        {'name': 'a', 'state': 'done', 'folder': 'a', 'variants': 'best'},
        {'name': 'b', 'state': 'failed', 'message': 'no', 'folder': None, 'variants': 'best'},
        {'name': 'c', 'state': 'done', 'folder': 'c'},
    ]
    (tmp_path / 'results.json').write_text(json.dumps({'runs': runs, 'groups': []}))
    (tmp_path / 'lap').mkdir()
    config = {'scenario': '1', 'controller': 'rstdp', 'seed': 0, 'lane': 'outer'}
    (tmp_path / 'lap' / 'config.yaml').write_text(json.dumps(config))
    (tmp_path / 'lap' / 'metrics.json').write_text(json.dumps(lap('rstdp', '').metrics))
    assert collect([tmp_path]).variants == {tmp_path / 'a': 'best'}
