"""Robots and engines by name: entry points of the groups `spikelane.robots`, `spikelane.engines`.

What cannot be imported is in nobody's way: the reason is told to those who ask for it.
"""

from __future__ import annotations

from collections.abc import Mapping
import functools
from typing import TypeVar

from spikelane_sim.engine import Engine
from spikelane_sim.entry_points import registered
from spikelane_sim.errors import ParameterError
from spikelane_sim.robots.model import RobotModel

ROBOT_GROUP = 'spikelane.robots'
ENGINE_GROUP = 'spikelane.engines'
_OWN = 'spikelane_sim'

KindT = TypeVar('KindT', RobotModel, Engine)


def robot_models() -> Mapping[str, RobotModel | str]:
    """Return all robots by name; for one that cannot be had, the reason."""
    return _registered(ROBOT_GROUP, RobotModel)


def engines() -> Mapping[str, Engine | str]:
    """Return all engines by name; for one that cannot be had, the reason."""
    return _registered(ENGINE_GROUP, Engine)


def robot_model(name: str) -> RobotModel:
    """Return a robot.

    Raises:
        ParameterError: No robot has this name, or it cannot be had.
    """
    return _known('robot.model', robot_models(), name)


def engine(name: str) -> Engine:
    """Return an engine.

    Raises:
        ParameterError: No engine has this name, or it cannot be had.
    """
    return _known('robot.engine', engines(), name)


def _known(what: str, found: Mapping[str, KindT | str], name: str) -> KindT:
    if name not in found:
        raise ParameterError(f'{what}: expected one of {", ".join(found)}, got {name!r}')
    value = found[name]
    if isinstance(value, str):
        raise ParameterError(f'{what}: {name} cannot be used: {value}')
    return value


@functools.cache
def _registered(group: str, kind: type[KindT]) -> Mapping[str, KindT | str]:
    found: dict[str, KindT | str] = {}
    for point in registered(group, _OWN):
        try:
            value = point.load()
        # Another package's module can raise anything; one that calls sys.exit must not end us.
        except (Exception, SystemExit) as error:
            found[point.name] = f'expected {point.value}, got {error!r:.200}'
        else:
            is_kind = isinstance(value, kind)
            found[point.name] = (
                value if is_kind else f'expected {kind.__name__}, got {value!r:.200}'
            )
    return found
