"""The page on the learning rule: its code is the code, its numbers are right."""

from __future__ import annotations

import math
from pathlib import Path
import re
import textwrap

import numpy as np
import pytest

from spikelane_controllers.spiking.network import DelayParameters
from spikelane_controllers.spiking.neuron import neuron_constants, NeuronParameters
from spikelane_controllers.spiking.plasticity import resting_plastic_state, run_plastic_network
from spikelane_controllers.spiking.spikes import SPIKE_DTYPE
from spikelane_controllers.spiking.synapse import synapse_rule, SynapseParameters

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / 'docs/learning_rule.md').read_text('utf-8')
#: Rows of the example: time, event, K_plus, K_minus, c, n and change of w.
ROWS = re.findall(r'^\| (\d+\.\d) \| ([a-z ]+) \|' + r' (\d+\.\d{6}) \|' * 5 + '$', PAGE, re.M)


def expected() -> list[tuple[float, ...]]:
    """Solve the example by the paper's sums over pairs and integrals, event by event."""
    relay, neuron = (3.0, 21.0), (8.6, 26.1)
    rows = []
    for at in sorted([*relay, *neuron, 50.0]):
        # c is a sum over pairs, each of which decays from its later spike on.
        pairs = [
            (max(pre, post), math.exp(-abs(post - pre) / 20) * (1 if post > pre else -1))
            for pre in relay
            for post in neuron
            if max(pre, post) <= at
        ]
        c = sum(w * math.exp(-(at - begin) / 1000) for begin, w in pairs)
        rate = 1 / 1000 + 1 / 200
        change = sum(
            w * 0.001 * math.exp(-begin / 200) * (1 - math.exp(-rate * (at - begin))) / rate
            for begin, w in pairs
        )
        k_plus, k_minus = (
            sum(math.exp(-(at - t) / 20) for t in times if t <= at) for times in (relay, neuron)
        )
        rows.append((at, k_plus, k_minus, c, math.exp(-at / 200), 1000 * change))
    return rows


def test_the_numbers_of_the_page_are_those_of_the_equations() -> None:
    """All six digits of every row."""
    assert [event for _, event, *_ in ROWS] == [
        'relay',
        'neuron',
        'relay',
        'neuron',
        'end of the step',
    ]
    for (at, _, *values), (time, *solved) in zip(ROWS, expected(), strict=True):
        assert float(at) == time
        assert [float(each) for each in values] == pytest.approx(solved, abs=5.1e-7)


@pytest.mark.parametrize('interval_ms', [1.0, 0.1])
def test_the_example_is_what_the_code_computes(interval_ms: float) -> None:
    """The neuron's spikes, and all that is left at the step's end, with and without NEST's way."""
    delays = DelayParameters()
    rule = synapse_rule(SynapseParameters(interval_ms=interval_ms), delays)
    rest = resting_plastic_state(np.array([[1500.0]]), delays)
    state, fired = run_plastic_network(
        rest._replace(dopamine=np.array([0.1 * 0.01])),
        np.array([(19, 0), (199, 0)], SPIKE_DTYPE),  # 2 and 20 ms after the beginning
        neuron_constants(NeuronParameters()),
        rule,
    )
    assert fired['step'].tolist() == [75, 250]  # 7.6 and 25.1 ms
    _, _, k_plus, _, c, n, change = ROWS[-1]
    assert state.k_plus[0, 0] == pytest.approx(float(k_plus), abs=5.1e-7)
    assert state.eligibility[0, 0] == pytest.approx(float(c), abs=5.1e-7)
    assert 1000 * state.dopamine[0] == pytest.approx(float(n), abs=5.1e-7)
    assert 1000 * (state.weights_pa[0, 0] - 1500) == pytest.approx(float(change), abs=5.1e-7)


def test_the_code_of_the_page_is_the_code() -> None:
    """Every block, line by line, in the file that the page names."""
    folder = ROOT / 'controllers/spikelane_controllers'
    blocks = re.findall(r'^```python\n(.*?)^```', PAGE, re.M | re.S)
    kernel = (folder / 'spiking/synapse_kernel.py').read_text('utf-8')
    controller = (folder / 'rstdp/controller.py').read_text('utf-8')
    assert len(blocks) == 4
    for block, source in zip(blocks, (kernel, kernel, kernel, controller), strict=True):
        found = (textwrap.indent(block, ' ' * spaces) in source for spaces in (4, 8))
        assert any(found), block


def test_the_tests_that_the_page_names_are_there() -> None:
    """Each in the file that its link leads to."""
    named = re.findall(r'\[`(test_\w+)`\]\(\.\./(tests/[\w/.]+)\)', PAGE)
    assert len(named) == 9
    for name, file in named:
        assert f'def {name}(' in (ROOT / file).read_text('utf-8')
