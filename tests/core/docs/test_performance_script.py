"""The script that measures cost against size: each kind of measurement, for the smallest size."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
import re
from types import ModuleType

import pandas as pd
import pytest

DOCS = Path(__file__).parents[3] / 'docs'
SCRIPT = DOCS / 'results/performance.py'


def module_of(file: Path) -> ModuleType:
    """Return a script of the results as a module."""
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(file.parent)  # as where it is run
        spec.loader.exec_module(module)
    return module


@pytest.fixture(scope='module')
def script() -> ModuleType:
    """Give the script that measures."""
    return module_of(SCRIPT)


@pytest.fixture(scope='module')
def writer() -> ModuleType:
    """Give the module that writes the page."""
    return module_of(SCRIPT.with_name('performance_page.py'))


def test_each_kind_is_measured_told_and_drawn(
    script: ModuleType,
    writer: ModuleType,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A row of the table for each, with a range around its median."""
    sizes = [
        *(('fleet', robots, threads) for robots in (1, 4) for threads in (1, 2)),
        ('camera', 64, 1),
        ('camera, anti-aliased', 64, 1),
        ('network', 2, 32),
        ('network', 3, 50),
    ]
    for size in sizes:
        script.measure_here(*size, script.Effort(2, 64, 8, 3, 0))
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [(row['what'], row['size'], row['other']) for row in rows] == sizes
    for row in rows:
        assert 0 < row['processor_low_us'] <= row['processor_us'] <= row['processor_high_us']
        assert row['wall_us'] > 0
        assert 100 < row['memory_mb'] < 10_000
    data = pd.DataFrame(rows)
    table = writer.table(data).splitlines()
    assert len(table) == 2 + len(sizes)
    assert re.match(r'\| 4 robots, 2 threads \| robot-step \| [\d.,]+ \| .* to .* \|', table[5])
    script.draw(data, tmp_path / 'figure.png')
    assert (tmp_path / 'figure.png').read_bytes().startswith(b'\x89PNG')


def test_the_page_has_what_was_measured(script: ModuleType, writer: ModuleType) -> None:
    """Its numbers and tables are those of the data, for all sizes, or say that there are none."""
    page = (DOCS / 'performance.md').read_text('utf-8')
    assert set(re.findall('<!-- measured: (.*) -->', page)) == set(writer.BLOCKS)
    if not script.DATA.exists():
        assert page.count('Not measured yet.') == len(writer.BLOCKS)
        return
    data = pd.read_csv(script.DATA)
    assert writer.fill(page, data) == page
    sizes = {
        what: list(zip(rows['size'], rows['other'], strict=True))
        for what, rows in data.groupby('what')
    }
    assert sizes == script.SIZES
    assert script.DATA.with_suffix('.png').is_file()


def test_a_page_is_filled_between_its_marks(writer: ModuleType) -> None:
    """What was there before goes; what is around stays."""
    page = 'a\n<!-- measured: ray -->\nold\n<!-- end -->\nb\n'
    rows = [{'what': 'ray', 'size': n, 'wall_us': 30e6 / n} for n in (1, 2)]
    filled = writer.fill(page, pd.DataFrame(rows))
    assert filled.startswith('a\n<!-- measured: ray -->\nThe eight trainings took 30 s on one ')
    assert 'worker and 15 s on two (2.00 times as fast)' in filled
    assert filled.endswith('\n<!-- end -->\nb\n')
    assert writer.fill(filled, None) == page.replace('old', 'Not measured yet.')


def test_sentences_follow_the_data(writer: ModuleType) -> None:
    """Busy or quiet, and how much two threads gain."""
    row = {'processor_us': 10.0, 'memory_mb': 250, 'machine': '2 x Chip'}
    row |= {'repeats': 5, 'count': 32_768}
    rows = [
        {**row, 'what': 'fleet', 'size': size, 'other': threads, 'wall_us': 20.0 / threads**0.5}
        for size in (1, 64, 1024)
        for threads in (1, 2)
    ]
    data = pd.DataFrame(rows).assign(load=[0.2, 0.4, 0.3, 0.2, 0.1, 4.5])
    told = writer.tell_machine(data)
    assert '(of one minute, before each measurement) of 0.1 to 4.5. The machine was busy' in told
    assert '0.2 to 0.4. The machine had little else to do.' in writer.tell_machine(data[:3])
    told = writer.tell_fleet(data)
    assert 'Two threads are 1.41 times as fast as one' in told
    assert 'per second: 70,700, with 1 robots on 2 threads' in told
    assert 'with 1,024 robots takes 250 MB' in told
    assert told.startswith('With 32,768 robot-steps in each measurement: a robot-step takes 10 ')


def test_what_is_named_is_measured_again_and_the_rest_kept(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rows stay in the order of the page."""
    monkeypatch.setitem(script.SIZES, 'network', [(2, 32)])
    data = pd.read_csv(script.DATA)
    kept = data[data['what'] != 'network']
    data.to_csv(tmp_path / 'data.csv', index=False)
    script.measure(tmp_path / 'data.csv', ['network'], ['--quick'])
    found = pd.read_csv(tmp_path / 'data.csv')
    assert found['what'].unique().tolist() == list(script.SIZES)
    pd.testing.assert_frame_equal(
        found[found['what'] != 'network'].reset_index(drop=True), kept.reset_index(drop=True)
    )
    (row,) = found[found['what'] == 'network'].itertuples()
    assert (row.size, row.other, row.repeats, row.count) == (2, 32, script.QUICK.repeats, 2)


def test_sizes_are_those_of_the_page(script: ModuleType) -> None:
    """From one robot to 1,024, from 64 to 512 px, from 2 neurons to 10,000, to 10^6 synapses."""
    sizes = script.SIZES
    assert {n for n, _ in sizes['fleet']} == {1, 4, 16, 64, 256, 1024}
    assert [px for px, _ in sizes['camera']] == [64, 128, 256, 512]
    assert min(sizes['network']) == (2, 32)
    assert max(neurons for neurons, _ in sizes['network']) == 10_000
    assert max(neurons * inputs for neurons, inputs in sizes['network']) == 10**6
    assert [workers for workers, _ in sizes['ray']] == [1, 2]
