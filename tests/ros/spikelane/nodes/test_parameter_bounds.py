"""Bounds of the nodes' own parameters, as of those outside nodes."""

from __future__ import annotations

import importlib
import inspect
import pkgutil

import spikelane.nodes
import spikelane.runs.replay.nodes
import spikelane_controllers.nodes
import spikelane_sim.nodes
from spikelane_sim.parameters import Parameters


def test_every_number_of_a_node_has_bounds() -> None:
    """Each whole number, number and list of numbers says its smallest and largest value."""
    classes = {
        cls
        for package in (
            spikelane_sim.nodes,
            spikelane_controllers.nodes,
            spikelane.nodes,
            spikelane.runs.replay.nodes,
        )
        for module in pkgutil.iter_modules(package.__path__, f'{package.__name__}.')
        for _, cls in inspect.getmembers(importlib.import_module(module.name), inspect.isclass)
        if issubclass(cls, Parameters) and '.nodes.' in cls.__module__
    }
    names = {cls.__name__ for cls in classes}
    assert names >= {
        'ControllerNodeParameters',
        'LearningNodeParameters',
        'RecorderParameters',
        'ReplayNodeParameters',
        'SimulatorNodeParameters',
        'ViewerParameters',
        'WheelsToTwistParameters',
    }
    without = [
        f'{cls.__name__}.{spec.name}'
        for cls in classes
        for spec in cls.specs()
        if spec.kind in (int, float) or (spec.kind is tuple and spec.item is float)
        if spec.low is None or spec.high is None
    ]
    assert sorted(without) == []
