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

from spikelane_sim.errors import PacketError
from spikelane_sim.events import EVENT_DTYPE, Events

#: A longer payload is refused. Real cameras send some 10 kB, the heaviest bursts a few MB.
MAX_BYTES = 64 * 2**20
#: More events in one packet are refused (vector words hold up to six events per byte).
MAX_EVENTS = 2**24
#: Stamps and time bases [ns] beyond the year 2116 are refused, which keeps sums inside int64.
MAX_TIME_NS = 2**62

EVENT_RECORD = numba.from_dtype(EVENT_DTYPE)

FINE = 0
UNKNOWN_WORD = 1
OUTSIDE = 2
NO_ADDRESS = 3
BACKWARDS = 4
TOO_MANY = 5
NEGATIVE_TIME = 6
POLARITY = 7
FRACTION = 8
OUT_OF_REACH = 9

_FAULTS = {
    UNKNOWN_WORD: 'expected a known word',
    OUTSIDE: 'expected coordinates inside the sensor',
    NO_ADDRESS: 'expected row and column before the event',
    BACKWARDS: 'expected times that do not decrease',
    TOO_MANY: f'expected at most {MAX_EVENTS} events in a packet',
    NEGATIVE_TIME: 'expected a time of zero or more',
    POLARITY: 'expected a polarity of +1 or -1',
    FRACTION: 'expected a time of whole microseconds',
    OUT_OF_REACH: "expected a time that the encoding reaches from the packet's stamp",
}

#: A payload: whatever has the buffer protocol.
Buffer: TypeAlias = 'bytes | bytearray | memoryview | array[int] | NDArray[Any]'
#: Events, FINE or the fault, and the index of the word or event at fault.
Decoded: TypeAlias = 'tuple[Events, int, int]'


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
    payload: NDArray[np.uint8] = np.frombuffer(data, np.uint8)
    if payload.size > MAX_BYTES:
        raise PacketError(
            f'{encoding} packet: expected at most {MAX_BYTES} bytes, got {payload.size}'
        )
    if payload.size % word_bytes:
        raise PacketError(
            f'{encoding} packet: expected words of {word_bytes} bytes, got {payload.size} bytes'
        )
    # The kernels are compiled for one type of array only.
    payload.flags.writeable = False
    return payload


def fault_error(encoding: str, fault: int, index: int, width: int, height: int) -> PacketError:
    """Return the error for what a kernel found."""
    return PacketError(
        f'{encoding} packet of {width} x {height} px: {_FAULTS[fault]}, not so at index {index}'
    )


@numba.njit(cache=True)
def uint_at(data: NDArray[np.uint8], start: int, n_bytes: int) -> np.int64:
    """Return the little-endian number that starts at this byte."""
    number = np.int64(0)
    for i in range(n_bytes):
        number |= np.int64(data[start + i]) << (8 * i)
    return number


@numba.njit(cache=True)
def put_event(events: Events, n: int, t_ns: int, x: int, y: int, on: int) -> None:
    """Write event n; `on` is the encodings' polarity bit, 1 for brighter."""
    events[n].t = t_ns
    events[n].x = x
    events[n].y = y
    events[n].polarity = 1 if on else -1


@numba.njit(cache=True)
def fault_of(t: int, latest: int, x: int, y: int, width: int, height: int, back: int) -> int:
    """Return what is wrong with an event, or FINE.

    A time up to `back` earlier than the latest one passes: the caller puts the latest in its
    place. Both are in the same unit.
    """
    if x < 0 or y < 0:
        return NO_ADDRESS
    if x >= width or y >= height:
        return OUTSIDE
    return FINE if latest - t <= back else BACKWARDS
