"""The bench's comparison with NEST."""

from __future__ import annotations

import argparse
import importlib.util
from typing import Any

import pytest

from spikelane.bench.plasticity import measure_plasticity
from spikelane.commands.bench import run


@pytest.mark.slow
def test_nest_and_we_simulate_the_same() -> None:
    """Otherwise their times could not be compared."""
    result = measure_plasticity(windows=40)
    assert result['same_spikes']
    assert result['weight_difference_pa'] < 1e-8
    assert result['ratio'] > result['ratio_simulate'] > 1.0


def test_where_nest_cannot_be_had_the_comparison_is_skipped(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is asked for once, and the message says how to get it and why it did not come."""
    found = importlib.util.find_spec

    def find(name: str, *others: Any) -> Any:
        return None if name == 'nest' else found(name, *others)

    monkeypatch.setattr(importlib.util, 'find_spec', find)
    for name in ('PIP_INDEX_URL', 'PIP_EXTRA_INDEX_URL'):
        monkeypatch.setenv(name, 'file:///nowhere')
    monkeypatch.setenv('PIP_IGNORE_INSTALLED', '1')
    monkeypatch.setenv('PIP_NO_CACHE_DIR', '1')
    assert run(argparse.Namespace(names=['plasticity'], json=False)) == 0
    said = capsys.readouterr()
    assert said.out == ''
    assert 'installing nest-simulator==3.10.0' in said.err
    assert 'skipped plasticity: expected NEST' in said.err
    assert 'pip install nest-simulator==3.10.0 (ERROR: No matching distribution' in said.err
