"""The encoding `mono`: a 64-bit word per event.

Bits 0 to 31 are the time since the packet's time base [ns], 32 to 47 the column, 48 to 62 the
row, 63 the polarity.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.codecs.payload import (
    BACK_US,
    BACKWARDS,
    Decoded,
    EVENT_RECORD,
    FINE,
    NO_TIME,
    OUT_OF_REACH,
    OUTSIDE,
    POLARITY,
    put_event,
    put_in_order,
    uint_at,
)
from spikelane_sim.compiled import inner
from spikelane_sim.events import Events


@numba.njit(cache=True)
def encode(
    events: Events, width: int, height: int, time_base_ns: int, words: NDArray[np.uint64]
) -> tuple[int, int, int]:
    """Write the words of a packet.

    Args:
        events: In the order of time.
        width: Columns of the sensor [px].
        height: Rows of the sensor [px].
        time_base_ns: Not after the first event, and less than 2**32 ns before the last.
        words: Room for one word per event.

    Returns:
        Number of words, FINE or the fault, index of the event at fault.
    """
    latest_ns = -(2**62)
    for i in range(len(events)):
        event = events[i]
        fault = _encoding_fault(event, time_base_ns, latest_ns, width, height)
        if fault:
            return i, fault, i
        latest_ns = event.t
        on = np.uint64(event.polarity > 0)
        address = on << np.uint64(15) | np.uint64(event.y)
        since_ns = np.uint64(event.t - time_base_ns)
        words[i] = address << np.uint64(48) | np.uint64(event.x) << np.uint64(32) | since_ns
    return len(events), FINE, 0


@inner
def _encoding_fault(event: Any, time_base_ns: int, latest_ns: int, width: int, height: int) -> int:
    if event.x >= width or event.y >= height:
        return OUTSIDE
    if event.polarity != 1 and event.polarity != -1:
        return POLARITY
    if event.t < time_base_ns or event.t - time_base_ns >= 2**32:
        return OUT_OF_REACH
    return FINE if event.t >= latest_ns else BACKWARDS


@numba.njit(cache=True)
def decode(data: NDArray[np.uint8], width: int, height: int, time_base_ns: int) -> Decoded:
    """Decode the words of a packet."""
    events = np.empty(len(data) // 8, EVENT_RECORD)
    n, latest_ns, is_in_order = 0, time_base_ns, True
    for i in range(len(events)):
        x, y_and_on = uint_at(data, 8 * i + 4, 2), uint_at(data, 8 * i + 6, 2)
        y = y_and_on & 0x7FFF
        if x >= width or y >= height:
            continue
        t_ns = time_base_ns + uint_at(data, 8 * i, 4)
        is_in_order &= t_ns >= latest_ns
        latest_ns = t_ns
        put_event(events, n, t_ns, x, y, y_and_on >> 15)
        n += 1
    ordered = events[:n] if is_in_order else put_in_order(events[:n], BACK_US * 1000)
    return ordered, FINE, 0, len(events) - n, n - len(ordered), NO_TIME
