"""The list of deviations in the docs: its form, its options, and that no default is missing."""

from __future__ import annotations

from fnmatch import fnmatch
from pathlib import Path
import re
from typing import Any

import pytest
import yaml

from spikelane_controllers.dqn_snn.transfer import TransferParameters
from spikelane_controllers.learning.gathering import GatheringParameters
from spikelane_controllers.learning.training import TrainingParameters
from spikelane_controllers.registry import controller_class, controller_names
from spikelane_sim.parameters import ParameterSpec
from spikelane_sim.simulator_parameters import SimulatorParameters

TEXT = (Path(__file__).parents[3] / 'docs/deviations.md').read_text('utf-8')
ITEMS = re.findall(r'^(\d+)\. (\*\*.+)$', TEXT, re.M)
CLASSES: dict[str, Any] = {
    'simulator': SimulatorParameters,
    'transfer': TransferParameters,
    'gathering': GatheringParameters,
    'training': TrainingParameters,
    **{name: controller_class(name).parameters_class for name in controller_names()},
}
SPECS: dict[str, ParameterSpec] = {
    spec.name: spec for group, cls in CLASSES.items() for spec in cls.specs(f'{group}.')
}
NAMED = set(re.findall(r'`([a-z_*]+(?:\.[a-z0-9_*]+)+)`', TEXT))
#: What says where, how long, how fast or with what to compute, and the sensor's size.
NOT_THE_PAPERS = (
    'simulator.course', 'simulator.speed', '*.checkpoint', '*.width', '*.height',
    'dqn.q_learning.device', 'dqn.q_learning.backend', 'training.save_every',
    'transfer.measure_every',
)  # fmt: skip
#: What the paper does not have, and what changes nothing by default.
ADDED = (
    'simulator.perturbation.*', 'simulator.randomisation.*', 'simulator.markings',
    'simulator.camera.contrast', 'simulator.camera.yaw_deg', 'simulator.pixels.dead_*',
    'simulator.robot.*_factor', 'simulator.robot.max_sideways_m_s2',
)  # fmt: skip


def test_they_are_numbered() -> None:
    """From 1, without gaps."""
    assert [int(number) for number, _ in ITEMS] == list(range(1, len(ITEMS) + 1))
    assert len(ITEMS) > 50


@pytest.mark.parametrize('item', [text for _, text in ITEMS])
def test_each_says_what_the_paper_has_why_it_is_otherwise_and_what_changes_it(item: str) -> None:
    """Under these words."""
    for word in ('paper', 'Why:', 'Option:'):
        assert re.search(rf'\*{word}', item, re.IGNORECASE), word


@pytest.mark.parametrize('name', sorted(NAMED - {'sensor.*'}))
def test_every_option_is_a_parameter(name: str) -> None:
    """Or several, by a pattern."""
    assert [each for each in SPECS if fnmatch(each, name)]


@pytest.mark.parametrize(('name', 'default'), re.findall(r'`([\w.*]+\.\w+)` \(`([^`]+)`', TEXT))
def test_every_default_is_as_declared(name: str, default: str) -> None:
    """In brackets after the name."""
    values = [spec.default for each, spec in SPECS.items() if fnmatch(each, name)]
    assert values
    assert all(value == yaml.safe_load(default) for value in values)


def test_every_default_that_is_not_the_papers_is_told_of() -> None:
    """That is, every one whose declaration names no place in the paper."""
    ours = {
        name for name, spec in SPECS.items() if not spec.source or 'author' in spec.source.lower()
    }
    patterns = (*NAMED, *NOT_THE_PAPERS, *ADDED)
    told = {name for name in ours if any(fnmatch(name, each) for each in patterns)}
    assert ours - told == set()
    assert len(ours) > 40
