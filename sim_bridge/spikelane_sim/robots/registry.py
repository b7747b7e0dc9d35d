"""Robots and engines by name: entry points of the groups `spikelane.robots`, `spikelane.engines`.

A robot or engine that cannot be imported affects no other; its request raises the reason.
"""

from __future__ import annotations

from collections.abc import Mapping

from spikelane_sim.engine import Engine
from spikelane_sim.entry_points import known, loaded
from spikelane_sim.robots.model import RobotModel

ROBOT_GROUP = 'spikelane.robots'
ENGINE_GROUP = 'spikelane.engines'
_OWN = 'spikelane_sim'


def robot_models() -> Mapping[str, RobotModel | str]:
    """Return all robots by name; for one that cannot be had, the reason."""
    return loaded(ROBOT_GROUP, RobotModel, _OWN)


def engines() -> Mapping[str, Engine | str]:
    """Return all engines by name; for one that cannot be had, the reason."""
    return loaded(ENGINE_GROUP, Engine, _OWN)


def robot_model(name: str) -> RobotModel:
    """Return a robot.

    Raises:
        ParameterError: No robot has this name, or it cannot be had.
    """
    return known('robot.model', robot_models(), name)


def engine(name: str) -> Engine:
    """Return an engine.

    Raises:
        ParameterError: No engine has this name, or it cannot be had.
    """
    return known('robot.engine', engines(), name)
