"""The encoding `libcaer`: iniVation's own polarity events, 64 bits each.

The low 32-bit word has the polarity in bit 1, the row in bits 2 to 16 and the column in bits 17
to 31; bit 0, iniVation's mark of validity, is not looked at, as in event_camera_codecs. The high
word is the time since the packet's time base [us], 31 bits that come round at most once.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.codecs.payload import (
    BACK_US,
    Decoded,
    EVENT_RECORD,
    FINE,
    NO_TIME,
    put_event,
    put_in_order,
    uint_at,
)

#: The time comes round after this [us].
ROUND_US = 2**31
#: It does so only between a count and another that are as near to it as this [us].
_NEAR_US = 2**26


@numba.njit(cache=True)
def decode(data: NDArray[np.uint8], width: int, height: int, time_base_ns: int) -> Decoded:
    """Decode the words of a packet."""
    events = np.empty(len(data) // 8, EVENT_RECORD)
    n, outside, first_us, latest_us, is_in_order = 0, 0, -1, 0, True
    for i in range(len(events)):
        address, t_us = uint_at(data, 8 * i, 4), uint_at(data, 8 * i + 4, 4)
        if t_us >= ROUND_US:  # a negative time: it counts as mistimed
            continue
        x, y = address >> 17, address >> 2 & 0x7FFF
        if x >= width or y >= height:
            outside += 1
            continue
        first_us = t_us if first_us < 0 else first_us
        if first_us >= ROUND_US - _NEAR_US and t_us < _NEAR_US:
            t_us += ROUND_US
        is_in_order &= t_us >= latest_us
        latest_us = t_us
        put_event(events, n, time_base_ns + t_us * 1000, x, y, address >> 1 & 1)
        n += 1
    ordered = events[:n] if is_in_order else put_in_order(events[:n], BACK_US * 1000)
    return ordered, FINE, 0, outside, len(events) - outside - len(ordered), NO_TIME
