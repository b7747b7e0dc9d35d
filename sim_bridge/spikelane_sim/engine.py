"""Engines: what moves a robot. A package registers one as an entry point.

The group is `spikelane.engines`; the entry point's name is the value of `robot.engine`, and it
names an `Engine`. The engine's own parameters are `robot.<name>.<parameter>`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TYPE_CHECKING

from spikelane_sim.contract import Robot
from spikelane_sim.parameters import Parameters

if TYPE_CHECKING:
    from spikelane_sim.robots import RobotParameters


class Engine(NamedTuple):
    """An engine.

    Attributes:
        make: Makes a robot at the origin, from its parameters, the number of poses that `step`
            returns, and the length of a step [s]. It may raise a ParameterError. It imports what
            takes long to import.
        parameters_class: The engine's own parameters, `getattr(parameters, name)` for `make`;
            None where it has none.
    """

    make: Callable[[RobotParameters, int, float], Robot]
    parameters_class: type[Parameters] | None = None
