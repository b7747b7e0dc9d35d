"""Robots and engines by name: entry points of the groups `spikelane.robots`, `spikelane.engines`.

A robot may also be the path of its URDF (`own.py`). A robot or engine that cannot be imported
affects no other; its request raises the reason.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from spikelane_sim.engine import Engine
from spikelane_sim.entry_points import known, loaded
from spikelane_sim.errors import ParameterError
from spikelane_sim.robots.model import RobotModel
from spikelane_sim.robots.own import ENDING, read_model

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

    Args:
        name: Its name, or the path of its URDF.

    Raises:
        ParameterError: No robot has this name, or it cannot be had, or its URDF lacks something.
    """
    if name.endswith(ENDING):
        return read_model(Path(name))
    models = robot_models()
    if name not in models:
        raise ParameterError(
            f'robot.model: expected one of {", ".join(models)}, or the path of a {ENDING} file, '
            f'got {name!r}'
        )
    return known('robot.model', models, name)


def values_of(name: str) -> RobotModel | None:
    """Return a robot for its values, None where it cannot be had, which others tell."""
    try:
        return robot_model(name)
    except ParameterError:
        return None


def engine(name: str) -> Engine:
    """Return an engine.

    Raises:
        ParameterError: No engine has this name, or it cannot be had.
    """
    return known('robot.engine', engines(), name)
