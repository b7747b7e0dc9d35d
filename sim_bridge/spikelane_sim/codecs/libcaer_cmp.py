"""The encoding `libcaer_cmp` of libcaer_driver: 16-bit words in the manner of EVT 3.0.

Rows and columns have changed places: the column is said once, and the row makes the event. Every
packet stands for itself. Times are 24 bits of microseconds since the packet's time base [ns], as
libcaer_driver writes them (event_camera_codecs 3.0 takes the time base for microseconds).
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
    MAX_EVENTS,
    NO_TIME,
    put_event,
    put_in_order,
    TOO_MANY,
    uint_at,
)
from spikelane_sim.compiled import inner

TIME_HIGH = 0x0  # bits 12-23 of the time [us]
TIME_LOW = 0x1  # bits 0-11 of the time [us]
ADDR_X = 0x2  # column in bits 0-10
ADDR_Y = 0x3  # row in bits 0-10, polarity in bit 11: one event
VECT_BASE_Y = 0x4  # first row of the vector words that follow, polarity in bit 11
VECT_8 = 0x5  # an event for each of 8 bits set, bit 0 at the base, which moves on by 8

_HIGH, _LOW, _COLUMN, _BASE, _BASE_ON, _ROW, _ON = range(7)
_UNKNOWN = -(2**40)


@numba.njit(cache=True)
def decode(data: NDArray[np.uint8], width: int, height: int, time_base_ns: int) -> Decoded:
    """Decode the words of a packet; it tells the time of its last time word [us]."""
    room = _count(data)
    if room > MAX_EVENTS:
        return np.empty(0, EVENT_RECORD), TOO_MANY, 0, 0, 0, NO_TIME
    events = np.empty(room, EVENT_RECORD)
    state = np.array([0, 0, _UNKNOWN, _UNKNOWN, 0, 0, 0])
    n, reserved, outside, latest_us, is_in_order = 0, 0, 0, 0, True
    for i in range(len(data) // 2):
        mask = _take(state, uint_at(data, 2 * i, 2))
        if mask < 0:
            reserved += 1
            continue
        t_us, x, y = state[_HIGH] | state[_LOW], state[_COLUMN], state[_ROW]
        while mask:
            if mask & 1 and 0 <= x < width and 0 <= y < height:
                is_in_order &= t_us >= latest_us
                latest_us = t_us
                put_event(events, n, time_base_ns + t_us * 1000, x, y, state[_ON])
                n += 1
            elif mask & 1:
                outside += 1
            mask >>= 1
            y += 1
    ordered = events[:n] if is_in_order else put_in_order(events[:n], BACK_US * 1000)
    return ordered, FINE, reserved, outside, n - len(ordered), _last_time_word(data, state)


@inner
def _last_time_word(data: NDArray[np.uint8], state: NDArray[np.int64]) -> int:
    """Return the time that the last time word tells [us], after all words are taken in."""
    for i in range(len(data) // 2 - 1, -1, -1):
        code = uint_at(data, 2 * i, 2) >> 12
        if code == TIME_LOW:
            return int(state[_HIGH] | state[_LOW])
        if code == TIME_HIGH:  # its low part is yet to come
            return int(state[_HIGH])
    return NO_TIME


@inner
def _count(data: NDArray[np.uint8]) -> int:
    """Return how many events the words make."""
    count = 0
    for i in range(len(data) // 2):
        word = uint_at(data, 2 * i, 2)
        if word >> 12 == ADDR_Y:
            count += 1
        elif word >> 12 == VECT_8:
            mask = word & 0xFF
            while mask:
                mask &= mask - 1
                count += 1
    return count


@inner
def _take(state: NDArray[np.int64], word: int) -> int:
    """Take a word in; return the mask of the events it makes from _ROW on, -1 if reserved."""
    code, value = word >> 12, word & 0xFFF
    if code == ADDR_Y:
        state[_ROW], state[_ON] = value & 0x7FF, value >> 11
        return 1
    if code == VECT_8:
        state[_ROW], state[_ON] = state[_BASE], state[_BASE_ON]
        state[_BASE] += 8
        return value & 0xFF
    if code == ADDR_X:
        state[_COLUMN] = value & 0x7FF
    elif code == VECT_BASE_Y:
        state[_BASE], state[_BASE_ON] = value & 0x7FF, value >> 11
    elif code == TIME_LOW:
        state[_LOW] = value
    elif code == TIME_HIGH:
        state[_HIGH] = value << 12
    else:
        return -1
    return 0
