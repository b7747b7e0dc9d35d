"""The script that measures cost against size: each kind of measurement, for the smallest size."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
import re
from types import ModuleType

import pandas as pd
import pytest

SCRIPT = Path(__file__).parents[3] / 'docs/results/performance.py'


@pytest.fixture(scope='module')
def script() -> ModuleType:
    """Give the script as a module that repeats little."""
    spec = importlib.util.spec_from_file_location('performance', SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.REPEATS, module.FLEET_STEPS, module.CAMERA_STEPS, module.WINDOWS = 2, 64, 8, 3
    return module


def test_each_kind_is_measured_told_and_drawn(
    script: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
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
        script.measure_here(*size)
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [(row['what'], row['size'], row['other']) for row in rows] == sizes
    for row in rows:
        assert 0 < row['processor_low_us'] <= row['processor_us'] <= row['processor_high_us']
        assert row['wall_us'] > 0
        assert 100 < row['memory_mb'] < 10_000
    data = pd.DataFrame(rows)
    script.print_table(data)
    table = capsys.readouterr().out.splitlines()
    assert len(table) == 2 + len(sizes)
    assert re.match(r'\| 4 robots, 2 threads \| robot-step \| [\d.,]+ \| .* to .* \|', table[5])
    script.draw(data, tmp_path / 'figure.png')
    assert (tmp_path / 'figure.png').read_bytes().startswith(b'\x89PNG')


def test_sizes_are_those_of_the_page(script: ModuleType) -> None:
    """From one robot to 1,024, from 64 to 512 px, from 2 neurons to 10,000, to 10^6 synapses."""
    sizes = script.SIZES
    assert {n for n, _ in sizes['fleet']} == {1, 4, 16, 64, 256, 1024}
    assert [px for px, _ in sizes['camera']] == [64, 128, 256, 512]
    assert min(sizes['network']) == (2, 32)
    assert max(neurons for neurons, _ in sizes['network']) == 10_000
    assert max(neurons * inputs for neurons, inputs in sizes['network']) == 10**6
    assert [workers for workers, _ in sizes['ray']] == [1, 2]
