"""EVT 3.0, Prophesee's encoding of 16-bit words: bits 15 to 12 are a code, the others a value.

The time is 24 bits of microseconds, so it repeats every 16.8 s, and a word that repeats what the
one before said is left out. The codes that are not listed below are reserved: such words are
skipped. Source: the layout as event_camera_codecs and Prophesee document it.
"""

from __future__ import annotations

from typing import TypeAlias

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.codecs.payload import (
    BACK_US,
    BACKWARDS,
    Decoded,
    EVENT_RECORD,
    FINE,
    FRACTION,
    MAX_EVENTS,
    NO_TIME,
    OUT_OF_REACH,
    OUTSIDE,
    POLARITY,
    put_event,
    put_in_order,
    TOO_MANY,
    uint_at,
)
from spikelane_sim.compiled import inner
from spikelane_sim.events import Events

ADDR_Y = 0x0  # row in bits 0-10; bit 11 says which camera of a pair
ADDR_X = 0x2  # column in bits 0-10, polarity in bit 11: one event
VECT_BASE_X = 0x3  # first column of the vector words that follow, polarity in bit 11
VECT_12 = 0x4  # an event for each bit set, bit 0 at the base, which moves on by 12
VECT_8 = 0x5  # the same with 8 bits
TIME_LOW = 0x6  # bits 0-11 of the time [us]
CONTINUED_4 = 0x7
TIME_HIGH = 0x8  # bits 12-23 of the time [us]
EXT_TRIGGER = 0xA
OTHERS = 0xE
CONTINUED_12 = 0xF

#: The time comes round after this [us].
ROUND_US = 2**24
#: How far a camera's TIME_HIGH may go back without having come round [us].
SLACK_US = 10 * 2**12
#: In place of a stamp: take the time as the sensor counts it.
NO_ANCHOR = -(2**62)

# What a decoder knows between words. Its clock: _STANDS until a TIME_HIGH, _NEEDS_LOW until a
# TIME_LOW, then _RUNS; high part of the time with the rounds counted [us]; low part [us].
_Clock: TypeAlias = tuple[int, int, int]
_STANDS, _NEEDS_LOW, _RUNS = range(3)
# Its place: row, column that the next vector word begins at, polarity bit of vector words. Row
# and column are negative while they are not known.
_Place: TypeAlias = tuple[int, int, int]
_UNKNOWN = -(2**40)
_NOTHING = np.array([_STANDS, 0, 0, _UNKNOWN, _UNKNOWN, 0], np.int64)


def new_state() -> NDArray[np.int64]:
    """Return the state of a decoder that has seen nothing: clock and place."""
    return _NOTHING.copy()


def resynchronise(state: NDArray[np.int64]) -> None:
    """Forget all but the count of rounds, so that events wait for new time and address words."""
    state[0] = _STANDS
    forget_place(state)


def forget_place(state: NDArray[np.int64]) -> None:
    """Forget row and vector base, so that events wait for new address words; the time goes on."""
    state[3] = state[4] = _UNKNOWN


@numba.njit(cache=True)
def encode(
    events: Events, width: int, height: int, base_us: int, stamp_us: int
) -> tuple[NDArray[np.uint16], int, int]:
    """Write the words of a packet.

    As a real camera does, the packet has every TIME_HIGH from its begin to its stamp, with events
    or without: readers take the time for come round only where 4095 is followed by 0.

    Args:
        events: In the order of time.
        width: Columns of the sensor [px].
        height: Rows of the sensor [px].
        base_us: The packet's begin, not after the first event.
        stamp_us: The packet's stamp; the first event has to be less than ROUND_US / 2 from it,
            every other from the one before.

    Returns:
        The words, FINE or the fault, index of the event at fault.
    """
    fault, index = _find_fault(events, width, height, stamp_us)
    if fault:
        return np.empty(0, np.uint16), fault, index
    end_us = max(stamp_us, events[-1].t // 1000) if len(events) else stamp_us
    # Every TIME_HIGH, and TIME_LOW, row and column of each event; both time words at both ends.
    words = np.empty(((end_us - base_us) >> 12) + 3 * len(events) + 5, np.uint16)
    n = _put_time(words, 0, base_us, base_us - 2**12)
    latest_us, row = base_us, -1
    for event in events:
        t_us = event.t // 1000
        if t_us != latest_us:
            n = _put_time(words, n, t_us, latest_us)
            latest_us = t_us
        if event.y != row:
            row = event.y
            words[n] = ADDR_Y << 12 | row
            n += 1
        words[n] = ADDR_X << 12 | (2048 if event.polarity > 0 else 0) | event.x
        n += 1
    if stamp_us >> 12 > latest_us >> 12:
        n = _put_time(words, n, stamp_us, latest_us)
    return words[:n], FINE, 0


@inner
def _find_fault(events: Events, width: int, height: int, stamp_us: int) -> tuple[int, int]:
    """Look for an event that cannot be written.

    Returns:
        FINE or the fault, index of the event at fault.
    """
    anchor_us = stamp_us
    for i in range(len(events)):
        event = events[i]
        t_us = event.t // 1000
        if event.x >= width or event.y >= height:
            return OUTSIDE, i
        if event.polarity != 1 and event.polarity != -1:
            return POLARITY, i
        if t_us * 1000 != event.t:
            return FRACTION, i
        if not -ROUND_US // 2 <= t_us - anchor_us < ROUND_US // 2:
            return OUT_OF_REACH, i
        if i and t_us < anchor_us:
            return BACKWARDS, i
        anchor_us = t_us
    return FINE, 0


@inner
def _put_time(words: NDArray[np.uint16], n: int, t_us: int, latest_us: int) -> int:
    """Write each TIME_HIGH that begins after the latest time, then TIME_LOW; return n after it."""
    for high in range((latest_us >> 12) + 1, (t_us >> 12) + 1):
        words[n] = TIME_HIGH << 12 | (high & 0xFFF)
        n += 1
    words[n] = TIME_LOW << 12 | (t_us & 0xFFF)
    return n + 1


@numba.njit(cache=True)
def decode(
    data: NDArray[np.uint8],
    width: int,
    height: int,
    anchor_us: int,
    state: NDArray[np.int64],
) -> Decoded:
    """Decode the words of a packet; it tells the time of its last time word [us].

    Args:
        data: The payload.
        width: Columns of the sensor [px].
        height: Rows of the sensor [px].
        anchor_us: Time that the first event's is nearest to, or NO_ANCHOR; every other event's
            is nearest to the one before.
        state: What the decoder knows; updated unless there is a fault.
    """
    room = _count(data)
    if room > MAX_EVENTS:
        return np.empty(0, EVENT_RECORD), TOO_MANY, 0, 0, 0, NO_TIME
    events = np.empty(room, EVENT_RECORD)
    # Tuples of numbers, for the compiler keeps these in registers.
    clock, place = (state[0], state[1], state[2]), (state[3], state[4], state[5])
    n, reserved, outside, mistimed = 0, 0, 0, 0
    latest_us, last_time_word_us = NO_TIME, NO_TIME
    is_in_order, is_time_wrong = True, False
    for i in range(len(data) // 2):
        word = uint_at(data, 2 * i, 2)
        code, value = word >> 12, word & 0xFFF
        if code == TIME_HIGH:
            is_time_wrong = clock[0] != _STANDS and _is_contradicted(data, i, clock[1])
            if is_time_wrong:
                continue
        if code in (TIME_LOW, TIME_HIGH):
            clock = _tick(clock, code, value)
            # The low part that belongs to a TIME_HIGH is yet to come.
            last_time_word_us = clock[1] | (clock[2] if code == TIME_LOW else 0)
            continue
        place, x, on, mask = _look(place, code, value)
        reserved += mask < 0
        if mask <= 0 or clock[0] != _RUNS:
            continue
        t_us = _time(clock[1] | clock[2], anchor_us)
        while mask:
            is_inside = x < width and place[0] < height
            if mask & 1 and is_inside and is_time_wrong:
                mistimed += 1
            elif mask & 1 and is_inside:
                is_in_order &= t_us >= latest_us
                latest_us = t_us
                anchor_us = t_us if anchor_us != NO_ANCHOR else NO_ANCHOR
                put_event(events, n, t_us * 1000, x, place[0], on)
                n += 1
            elif mask & 1:
                outside += 1
            mask, x = mask >> 1, x + 1
    state[0], state[1], state[2] = clock
    state[3], state[4], state[5] = place
    ordered = events[:n] if is_in_order else put_in_order(events[:n], BACK_US * 1000)
    last_time_word_us = last_time_word_us if clock[0] != _STANDS else NO_TIME
    mistimed += n - len(ordered)
    return ordered, FINE, reserved, outside, mistimed, last_time_word_us


@inner
def _count(data: NDArray[np.uint8]) -> int:
    """Return how many events the words can make."""
    count = 0
    for i in range(len(data) // 2):
        word = uint_at(data, 2 * i, 2)
        count += word >> 12 == ADDR_X
        if word >> 12 == VECT_12 or word >> 12 == VECT_8:
            mask = word & 0xFFF
            while mask:
                mask &= mask - 1
                count += 1
    return count


@inner
def _tick(clock: _Clock, code: int, value: int) -> _Clock:
    """Return the clock after a time word."""
    sync, high_us, low_us = clock
    if code == TIME_LOW:
        return (_RUNS if sync != _STANDS else sync), high_us, value
    bits_us = value << 12
    latest_bits_us = high_us & (ROUND_US - 1)
    came_round = latest_bits_us - bits_us > SLACK_US
    high_us = high_us - latest_bits_us + bits_us + (ROUND_US if came_round else 0)
    return max(sync, _NEEDS_LOW), high_us, low_us


@inner
def _is_contradicted(data: NDArray[np.uint8], i: int, high_us: int) -> bool:
    """Return whether the TIME_HIGH at word i is damaged, and not the first one after a jump.

    It is damaged if it does not continue the time so far, but the packet's next TIME_HIGH does.
    If the packet has no further TIME_HIGH, this cannot be decided and the word is taken as right.
    """
    this_us = (uint_at(data, 2 * i, 2) & 0xFFF) << 12
    if _continues(high_us, this_us):
        return False
    for j in range(i + 1, len(data) // 2):
        word = uint_at(data, 2 * j, 2)
        if word >> 12 == TIME_HIGH:
            next_us = (word & 0xFFF) << 12
            return _continues(high_us, next_us) and not _continues(this_us, next_us)
    return False


@inner
def _continues(high_us: int, next_us: int) -> bool:
    """Return whether a TIME_HIGH is at most SLACK_US from another, however often it came round."""
    return ((next_us - high_us + SLACK_US) & (ROUND_US - 1)) <= 2 * SLACK_US


@inner
def _look(place: _Place, code: int, value: int) -> tuple[_Place, int, int, int]:
    """Take in a word that is not of time.

    Returns:
        The place after it; column, polarity bit and mask of the events it makes from that column
        on. The mask is 0 if there are none or their address is not known, -1 for reserved words.
    """
    row, base, base_on = place
    x, on, mask = 0, 0, 0
    if code == ADDR_X:
        x, on, mask = value & 0x7FF, value >> 11, 1
    elif code == ADDR_Y:
        row = value & 0x7FF
    elif code == VECT_BASE_X:
        base, base_on = value & 0x7FF, value >> 11
    elif code == VECT_12:
        x, on, mask, base = base, base_on, value, base + 12
    elif code == VECT_8:
        x, on, mask, base = base, base_on, value & 0xFF, base + 8
    elif code not in (EXT_TRIGGER, OTHERS, CONTINUED_4, CONTINUED_12):
        mask = -1
    if row < 0 or x < 0:
        mask = min(mask, 0)
    return (row, base, base_on), x, on, mask


@inner
def _time(count_us: int, anchor_us: int) -> int:
    """Return the count, or the time nearest to the anchor with its 24 bits."""
    if anchor_us == NO_ANCHOR:
        return count_us
    half_us = ROUND_US // 2
    return anchor_us - half_us + ((count_us - anchor_us + half_us) & (ROUND_US - 1))
