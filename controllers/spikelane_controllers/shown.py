"""What a controller may show of its last step, to be published, recorded and counted."""

from __future__ import annotations

from collections.abc import Mapping
import math
from types import MappingProxyType
from typing import Any, NamedTuple, TYPE_CHECKING

from numpy.typing import NDArray

from spikelane_controllers.operations import Operations

if TYPE_CHECKING:
    from spikelane_controllers.quantities import Quantity, Sample

_NOTHING: Mapping[str, Any] = MappingProxyType({})


class Shown(NamedTuple):
    """What a controller shows of its last step; whatever it does not have stays as it is here.

    Attributes:
        neurons: Names of its neurons; they never change.
        spikes: How often each of them fired.
        action: Number of the action taken, -1 for none.
        reward: Reward learnt from, NaN for none.
        operations: What its network computed, None where that is not counted.
        weights_pa: Its weights [pA] where they are few enough to be looked at, (neurons, inputs).
        quantities: What it can record (`quantities`).
        recorded: Samples of the quantities that it was told to record, by name.
    """

    neurons: tuple[str, ...] = ()
    spikes: tuple[int, ...] = ()
    action: int = -1
    reward: float = math.nan
    operations: Operations | None = None
    weights_pa: NDArray[Any] | None = None
    quantities: tuple[Quantity, ...] = ()
    recorded: Mapping[str, Sample] = _NOTHING


def shown_by(controller: object) -> Shown:
    """Return what a controller shows: its attribute `shown`, or nothing where it has none."""
    found = getattr(controller, 'shown', None)
    return found if isinstance(found, Shown) else Shown()
