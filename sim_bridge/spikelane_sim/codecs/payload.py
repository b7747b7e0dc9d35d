"""What the encodings have in common: limits, the checks before decoding, and the error texts.

The kernels cannot raise an error with a text, so they return one of the numbers below and the
index of the word or event at fault.
"""

from __future__ import annotations

from array import array
from typing import Any, NamedTuple, TypeAlias

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.compiled import inner
from spikelane_sim.errors import PacketError
from spikelane_sim.events import EVENT_DTYPE, Events

#: A longer payload is refused. Real cameras send some 10 kB, the heaviest bursts a few MB.
MAX_BYTES = 64 * 2**20
#: More events in one packet are refused (vector words hold up to six events per byte).
MAX_EVENTS = 2**24
#: Stamps and time bases [ns] beyond the year 2116 are refused, which keeps sums inside int64.
MAX_TIME_NS = 2**62

EVENT_RECORD = numba.from_dtype(EVENT_DTYPE)
_BYTE = np.dtype(np.uint8)

#: The time of an event may be this much earlier than that of the event before [us]. It is then
#: replaced by the latter. The times of real cameras fall by up to ten counts of evt3's TIME_HIGH.
BACK_US = 11 * 2**12
#: In place of a time: the packet tells none.
NO_TIME = -(2**62)

FINE = 0
OUTSIDE = 1
BACKWARDS = 2
TOO_MANY = 3
POLARITY = 4
FRACTION = 5
OUT_OF_REACH = 6

_FAULTS = {
    OUTSIDE: 'expected coordinates inside the sensor',
    BACKWARDS: 'expected times that do not decrease',
    TOO_MANY: f'expected at most {MAX_EVENTS} events in a packet',
    POLARITY: 'expected a polarity of +1 or -1',
    FRACTION: 'expected a time of whole microseconds',
    OUT_OF_REACH: "expected a time that the encoding reaches from the packet's stamp",
}

#: A payload: whatever has the buffer protocol.
Buffer: TypeAlias = 'bytes | bytearray | memoryview | array[int] | NDArray[Any]'
#: What a decoding kernel returns: events, FINE or TOO_MANY, the three counts of `Dropped`, and the
#: latest time that the packet tells in the unit of its encoding, or NO_TIME.
Decoded: TypeAlias = 'tuple[Events, int, int, int, int, int]'


class Dropped(NamedTuple):
    """What of a packet was left out because it makes no sense."""

    reserved: int = 0  # words that the encoding does not define
    outside: int = 0  # events outside the image, or whose row or column is not known
    mistimed: int = 0  # events whose time does not fit those of the other events


class Layout(NamedTuple):
    """What an encoding can hold."""

    word_bytes: int
    max_width: int  # [px]
    max_height: int  # [px]


_LAYOUTS = {
    'evt3': Layout(2, 2**11, 2**11),
    'mono': Layout(8, 2**16, 2**15),
    'libcaer': Layout(8, 2**15, 2**15),
    'libcaer_cmp': Layout(2, 2**11, 2**11),
}
DECODABLE = tuple(_LAYOUTS)
ENCODABLE = ('evt3', 'mono')


def check_packet(encoding: str, stamp_ns: int, width: int, height: int) -> Layout:
    """Return the encoding's layout, or raise PacketError for what it cannot hold."""
    layout = _LAYOUTS.get(encoding)
    if layout is None:
        raise PacketError(f'event packet: expected an encoding of {DECODABLE}, got {encoding!r}')
    if not (0 < width <= layout.max_width and 0 < height <= layout.max_height):
        raise PacketError(
            f'{encoding} packet: expected a sensor of 1 x 1 to {layout.max_width} x '
            f'{layout.max_height} px, got {width} x {height}'
        )
    if not 0 <= stamp_ns < MAX_TIME_NS:
        raise PacketError(f'{encoding} packet: expected a stamp of 0 to 2**62 ns, got {stamp_ns}')
    return layout


def check_payload(encoding: str, data: Buffer, word_bytes: int) -> NDArray[np.uint8]:
    """Return the payload as read-only bytes, or raise PacketError for its length."""
    payload: NDArray[np.uint8] = np.frombuffer(data, _BYTE)
    size = len(payload)
    if size > MAX_BYTES:
        raise PacketError(f'{encoding} packet: expected at most {MAX_BYTES} bytes, got {size}')
    if size % word_bytes:
        raise PacketError(
            f'{encoding} packet: expected words of {word_bytes} bytes, got {size} bytes'
        )
    # The kernels are compiled for one type of array only.
    payload.setflags(write=False)
    return payload


def fault_error(encoding: str, fault: int, index: int, width: int, height: int) -> PacketError:
    """Return the error for what a kernel found."""
    return PacketError(
        f'{encoding} packet of {width} x {height} px: {_FAULTS[fault]}, not so at index {index}'
    )


@inner
def uint_at(data: NDArray[np.uint8], start: int, n_bytes: int) -> np.int64:
    """Return the little-endian number that starts at this byte."""
    number = np.int64(0)
    for i in range(n_bytes):
        number |= np.int64(data[start + i]) << (8 * i)
    return number


@inner
def put_event(events: Events, n: int, t_ns: int, x: int, y: int, on: int) -> None:
    """Write event n; `on` is the encodings' polarity bit, 1 for brighter."""
    events[n].t = t_ns
    events[n].x = x
    events[n].y = y
    events[n].polarity = 1 if on else -1


@inner
def put_in_order(events: Events, back_ns: int) -> Events:
    """Make the times of a packet's events non-decreasing.

    A time that is earlier than the one before by up to `back_ns` is replaced by it. Where times
    differ by more, either those that are too early or those that are too late are wrong: the
    smaller number of events is left out.

    Args:
        events: The packet's events, changed in place, (N,).
        back_ns: How far times may fall [ns].

    Returns:
        The events that are kept, (M,).
    """
    n = len(events)
    too_early, too_late = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    highest, lowest = events[0].t, events[n - 1].t
    for i in range(n):
        highest = max(highest, events[i].t)
        too_early[i] = highest - events[i].t > back_ns
        last = n - 1 - i
        lowest = min(lowest, events[last].t)
        too_late[last] = events[last].t - lowest > back_ns
    is_left_out = too_early if too_early.sum() <= too_late.sum() else too_late
    n_ordered = 0
    for i in range(n):
        if not is_left_out[i]:
            t_ns = events[i].t if n_ordered == 0 else max(events[i].t, events[n_ordered - 1].t)
            events[n_ordered] = events[i]
            events[n_ordered].t = t_ns
            n_ordered += 1
    return events[:n_ordered]
