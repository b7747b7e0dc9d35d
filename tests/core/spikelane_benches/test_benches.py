"""The comparisons of the bench with other programs."""

from __future__ import annotations

import importlib.util
import math
import os
from pathlib import Path
import re
from typing import Any

import pytest

from spikelane.commands.bench import find_benches
from spikelane.main import run as run_command
from spikelane_benches.benchmarks import run
from spikelane_benches.dqn import measure_dqn
from spikelane_benches.dqn_training import measure_dqn_training
from spikelane_benches.engines import measure_engines
from spikelane_benches.plasticity import measure_plasticity
from spikelane_benches.q_learning import measure_q_learning
from spikelane_benches.real_time import measure_real_time, summary
from spikelane_sim.errors import SpikelaneError


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
    assert run(['plasticity'], as_json=False) == 0
    said = capsys.readouterr()
    assert said.out == ''
    assert 'installing nest-simulator==3.10.0' in said.err
    assert 'skipped plasticity: expected NEST' in said.err
    assert 'pip install nest-simulator==3.10.0 (ERROR: No matching distribution' in said.err


def test_delays_of_answers_are_summed_up() -> None:
    """A period is 10 ms; an answer that never came is later than any other."""
    delays = [float(delay) for delay in range(1, 11)] * 99 + [10.5] * 8 + [None] * 2
    found = summary(delays, [10.0] * 999 + [20.5])
    assert found == {
        'on_time_percent': 99.0,
        'p50_ms': 6.0,
        'p99_ms': 10.5,
        'p999_ms': math.inf,
        'max_ms': math.inf,
        'late_ticks_percent': 0.1,
    }


@pytest.mark.ros
def test_answers_in_real_time_are_timed() -> None:
    """The delays of all steps after the first ones count, with both controllers."""
    before = os.sched_getscheduler(0)
    result = measure_real_time(steps=100)
    for name in ('rstdp', 'dqn_snn'):
        assert 0 < result[f'{name}_p50_ms'] <= result[f'{name}_p99_ms']
        assert 0 <= result['on_time_percent'] <= result[f'{name}_on_time_percent'] <= 100
    assert result['scheduling'] in ('real-time', 'usual')
    assert os.sched_getscheduler(0) == before


@pytest.mark.slow
def test_both_ways_of_deep_q_learning_are_timed() -> None:
    """In the same environment, and the policies are driven on both lanes."""
    result = measure_dqn(steps=60)
    assert result['ratio'] == pytest.approx(result['ours_us'] / result['theirs_us'])
    rewards = [
        result[f'{who}_{lane}'] for who in ('ours', 'theirs') for lane in ('outer', 'inner')
    ]
    assert all(0 < reward < 2660 for reward in rewards)


def test_both_backends_of_q_learning_are_timed() -> None:
    """With the same transitions, after the buffer has the random ones."""
    result = measure_q_learning(actions=80)
    assert result['ratio'] == pytest.approx(result['numba_us'] / result['torch_us'])
    assert all(value > 0 for value in result.values())


def test_trainings_of_the_dqn_are_timed() -> None:
    """With both engines and both backends, each against pybullet and PyTorch."""
    result = measure_dqn_training(actions=30, repeats=1)
    for name in ('pybullet_numba', 'pybullet_10ms_numba', 'rigid_torch', 'rigid_numba'):
        assert result[name] == pytest.approx(result[f'{name}_us'] / result['pybullet_torch_us'])
        assert result[f'{name}_low'] == result[name] == result[f'{name}_high']
    assert all(value > 0 for value in result.values())


def test_without_stable_baselines_the_comparison_is_skipped(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The message says how to get it."""
    found = importlib.util.find_spec

    def find(name: str, *others: Any) -> Any:
        return None if name == 'stable_baselines3' else found(name, *others)

    monkeypatch.setattr(importlib.util, 'find_spec', find)
    assert run(['dqn'], as_json=False) == 0
    said = capsys.readouterr()
    assert said.out == ''
    assert 'skipped dqn: expected Stable-Baselines3' in said.err
    pinned = Path(__file__).parents[3] / 'requirements/constraints.txt'
    (version,) = re.findall('stable-baselines3==(.*)', pinned.read_text())
    assert f'pip install stable-baselines3=={version}' in said.err


def test_the_command_finds_the_benches_of_its_checkout(capsys: pytest.CaptureFixture[str]) -> None:
    """It names them where it is given another name."""
    assert run_command(['bench', 'nothing']) == 2
    error = capsys.readouterr().err
    assert error.startswith('spikelane bench: expected closed-loop-pybullet, ')
    assert error.endswith("got 'nothing'\n")


def test_an_installed_copy_has_no_benches(tmp_path: Path) -> None:
    """One sentence says what was looked for, and what to do."""
    module = tmp_path / 'lib/python3.12/site-packages/spikelane/commands/bench.py'
    with pytest.raises(SpikelaneError) as raised:
        find_benches(module)
    assert str(raised.value) == (
        f'expected benches/spikelane_benches in a folder above {module.parent}, got none: '
        "an installed copy has no benches; use ./spikelane in a checkout of Spikelane's repository"
    )


def test_the_rigid_body_is_far_cheaper_than_pybullet() -> None:
    """By processor times of one run; the kernel alone takes less than a call of it."""
    result = measure_engines(steps=100, repeats=3)
    assert result['ratio'] == pytest.approx(result['pybullet_us'] / result['rigid_us'])
    assert result['ratio'] > 5
    assert 0.02 < result['kernel_us'] < result['rigid_us']
