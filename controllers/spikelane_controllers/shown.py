"""What a controller may show of its last step, to be published, recorded and counted."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from numpy.typing import NDArray

from spikelane_controllers.operations import Operations


class Shown(NamedTuple):
    """What a controller shows of its last step; whatever it does not have stays as it is here.

    Attributes:
        neurons: Names of its neurons; they never change.
        spikes: How often each of them fired.
        action: Number of the action taken, -1 for none.
        reward: Reward learnt from, NaN for none.
        operations: What its network computed, None where that is not counted.
        weights_pa: Its weights [pA] where they are few enough to be looked at, (neurons, inputs).
    """

    neurons: tuple[str, ...] = ()
    spikes: tuple[int, ...] = ()
    action: int = -1
    reward: float = math.nan
    operations: Operations | None = None
    weights_pa: NDArray[Any] | None = None


def shown_by(controller: object) -> Shown:
    """Return what a controller shows: its attribute `shown`, or nothing where it has none."""
    found = getattr(controller, 'shown', None)
    return found if isinstance(found, Shown) else Shown()
