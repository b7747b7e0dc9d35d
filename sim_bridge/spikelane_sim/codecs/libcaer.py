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
    Decoded,
    EVENT_RECORD,
    fault_of,
    FINE,
    NEGATIVE_TIME,
    put_event,
    uint_at,
)

#: The time comes round after this [us].
ROUND_US = 2**31


@numba.njit(cache=True)
def decode(
    data: NDArray[np.uint8], width: int, height: int, time_base_ns: int, back_us: int
) -> Decoded:
    """Decode the words of a packet; a time earlier by up to back_us is the one before it."""
    events = np.empty(len(data) // 8, EVENT_RECORD)
    rounds_us, latest_us = 0, 0
    for i in range(len(events)):
        address, count_us = uint_at(data, 8 * i, 4), uint_at(data, 8 * i + 4, 4)
        if count_us >= ROUND_US:
            return events[:0], NEGATIVE_TIME, i
        if rounds_us == 0 and latest_us - count_us > ROUND_US // 2:
            rounds_us = ROUND_US
        t_us, x, y = rounds_us + count_us, address >> 17, address >> 2 & 0x7FFF
        fault = fault_of(t_us, latest_us, x, y, width, height, back_us)
        if fault:
            return events[:0], fault, i
        latest_us = max(t_us, latest_us)
        put_event(events, i, time_base_ns + latest_us * 1000, x, y, address >> 1 & 1)
    return events, FINE, 0
