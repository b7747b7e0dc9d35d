"""Bounds of parameters: every number has them, and what multiplies is checked as a product."""

from __future__ import annotations

from collections.abc import Iterator
import importlib
import pkgutil
from typing import Any

import pytest

import spikelane
from spikelane.runs.configuration import Request
from spikelane.runs.transfer.config import TransferConfig
import spikelane_controllers
from spikelane_controllers.braitenberg.controller import BraitenbergParameters
from spikelane_controllers.dqn.parameters import DqnParameters
from spikelane_controllers.dqn_snn.controller import DqnSnnParameters
from spikelane_controllers.learning.gathering import GatheringParameters
from spikelane_controllers.rstdp.controller import RStdpParameters
import spikelane_sim
from spikelane_sim.encoding import StateImageParameters
from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import Parameters
from spikelane_sim.simulator_parameters import SimulatorParameters


def _classes(cls: type[Parameters]) -> Iterator[type[Parameters]]:
    for each in cls.__subclasses__():
        yield each
        yield from _classes(each)


def test_every_number_has_bounds() -> None:
    """Each whole number, number and list of numbers says its smallest and largest value."""
    for package in (spikelane_sim, spikelane_controllers, spikelane):
        for module in pkgutil.walk_packages(package.__path__, f'{package.__name__}.'):
            # Launch files need a full ROS installation; nodes need one at all.
            if '.launch' not in module.name and '.nodes' not in module.name:
                importlib.import_module(module.name)
    classes = [each for each in _classes(Parameters) if each.__module__.startswith('spikelane')]
    assert len(classes) > 30
    without = [
        f'{cls.__name__}.{spec.name}'
        for cls in classes
        for spec in cls.specs()
        if spec.kind in (int, float) or (spec.kind is tuple and spec.item is float)
        if spec.low is None or spec.high is None
    ]
    assert without == []


@pytest.mark.parametrize(
    ('cls', 'values', 'message'),
    [
        (
            BraitenbergParameters,
            {'poisson.max_rate_hz': 1e12},
            'from 0 to 10000 Hz, got 1000000000000.0',
        ),
        (DqnParameters, {'network.hidden_1': 10**9}, 'from 1 to 16384, got 1000000000'),
        (StateImageParameters, {'frames': 10**9}, 'from 1 to 1000, got 1000000000'),
        (DqnParameters, {'q_learning.buffer_size': 10**30}, 'from 1 to 10000000, got 10'),
    ],
)
def test_what_would_fill_the_memory_is_refused(
    cls: type[Parameters], values: dict[str, Any], message: str
) -> None:
    """In one line with the largest value allowed."""
    with pytest.raises(ParameterError, match=message) as caught:
        cls.from_mapping(values)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(
    ('cls', 'values', 'message'),
    [
        (
            DqnParameters,
            {'network.hidden_1': 10_000, 'network.hidden_2': 10_000},
            'expected at most 40,000,000 weights, got 10512 x 10000 = 105,120,000',
        ),
        (
            DqnParameters,
            {'q_learning.batch_size': 65_536, 'image.cell': 1},
            r'expected at most 100,000,000 values, got 8192 x 65536 = 536,870,912',
        ),
        (
            DqnParameters,
            {'q_learning.buffer_size': 10_000_000},
            'expected at most 4,000,000,000 values, got 512 x 10000000',
        ),
        (
            StateImageParameters,
            {'frames': 1000, 'width': 2048, 'height': 2048, 'cell': 2},
            'expected at most 10,000,000 counts, got 1000 x 992 x 1024 = 1,015,808,000',
        ),
        (
            RStdpParameters,
            {'encoding.cell': 1, 'poisson.max_rate_hz': 1e4},
            'expected at most 100,000,000 comparisons in a step, got 4096000 x 8192',
        ),
        (
            DqnSnnParameters,
            {
                'neurons.simulated_ms': 1000.0,
                'neurons.step_ms': 0.1,
                'encoding.cell': 1,
            },
            'expected at most 10,000,000 numbers drawn in a step, got 10000 x 8192',
        ),
        (
            DqnSnnParameters,
            {'neurons.simulated_ms': 1e4, 'neurons.step_ms': 0.001, 'neurons.max_rate_hz': 1.0},
            'expected at most 1000000 steps of step_ms = 0.001 ms, got 10000 ms',
        ),
        (
            GatheringParameters,
            {'states': 10_000_000},
            'expected at most 500,000,000 counts, got 10000000 x 512',
        ),
        (
            SimulatorParameters,
            {'pixels.model': 'esim', 'pixels.esim.substeps': 1000}
            | {'camera.width': 512, 'camera.height': 512},
            'expected at most 134,217,728 samples of the ground in a step, got 512 x 512 x 1 x 1',
        ),
        (
            SimulatorParameters,
            {'camera.antialias': True, 'camera.width': 2048, 'camera.height': 2048}
            | {'pixels.coppelia.noise_rate_hz': 1000.0},
            'expected at most 200,000,000 noise events per second, got 2048 x 2048 x 1000',
        ),
    ],
)
def test_parameters_that_multiply_are_checked_as_a_product(
    cls: type[Parameters], values: dict[str, Any], message: str
) -> None:
    """Each is within its own bounds; the error gives the factors, the product and the limit."""
    with pytest.raises(ParameterError, match=message) as caught:
        cls.from_mapping(values)
    assert '\n' not in str(caught.value)


def test_a_transfer_checks_inputs_times_hidden_units() -> None:
    """They are parameters of different groups."""
    large = {'gathering.encoding.cell': 1, 'transfer.hidden': 16_384, 'gathering.states': 100}
    with pytest.raises(ParameterError, match='at most 40,000,000 weights, got 8192 x 16384'):
        TransferConfig.plan(Request('1', 'dqn_snn', 0, parameters=large), 'scenario_1', False)


def test_defaults_with_the_largest_camera_are_allowed() -> None:
    """Limits on products leave room for what a sensor of 4 million pixels needs."""
    size = {'camera.width': 2048, 'camera.height': 2048}
    for more in ({}, {'camera.antialias': True}, {'pixels.model': 'esim'}):
        SimulatorParameters.from_mapping(size | more)
