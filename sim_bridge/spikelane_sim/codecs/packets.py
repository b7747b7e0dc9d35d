"""Event packets encoded and decoded, whatever the encoding."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.codecs import evt3, libcaer, libcaer_cmp, mono
from spikelane_sim.codecs.payload import (
    Buffer,
    check_packet,
    check_payload,
    Decoded,
    ENCODABLE,
    fault_error,
    FINE,
    MAX_BYTES,
    MAX_TIME_NS,
)
from spikelane_sim.contract import STEP_NS
from spikelane_sim.errors import PacketError
from spikelane_sim.events import EVENT_DTYPE, Events

#: A camera's time may go back by this within a packet [us].
BACK_US = evt3.SLACK_US


class EncodedPacket(NamedTuple):
    """What an EventPacket carries besides its header and counter, always little endian."""

    encoding: str
    width: int  # [px]
    height: int  # [px]
    time_base_ns: int
    data: bytes


def encode(encoding: str, events: Events, stamp_ns: int, width: int, height: int) -> EncodedPacket:
    """Encode the events of one step.

    The time base is the start of the step that the stamp ends, or the first event's time if that
    is earlier. An evt3 packet begins with both time words, so that it can be read by itself.

    Args:
        encoding: 'evt3' (times in whole microseconds) or 'mono'.
        events: Array of EVENT_DTYPE in the order of time, (N,); the order is kept.
        stamp_ns: The packet's stamp: simulation time at the end of the step.
        width: Columns of the sensor [px].
        height: Rows of the sensor [px].

    Raises:
        PacketError: The events are not valid for this sensor, or their times are more than the
            encoding reaches (evt3: 8.3 s from the stamp, mono: 4.2 s from the time base).
    """
    check_packet(encoding, stamp_ns, width, height)
    if encoding not in ENCODABLE:
        raise PacketError(f'event packet: expected to encode {ENCODABLE}, got {encoding!r}')
    events = _check_events(events)
    width, height, stamp_ns = int(width), int(height), int(stamp_ns)
    base_ns = max(0, stamp_ns - STEP_NS)
    if len(events):
        base_ns = max(0, min(base_ns, int(events[0]['t'])))
    if encoding == 'evt3':
        words = np.empty(2 + 4 * len(events), np.uint16)
        n, fault, index = evt3.encode(events, width, height, stamp_ns // 1000, words)
    else:
        words = np.empty(len(events), np.uint64)
        n, fault, index = mono.encode(events, width, height, base_ns, words)
    if fault != FINE:
        raise fault_error(encoding, fault, index, width, height)
    return EncodedPacket(encoding, width, height, base_ns, words[:n].tobytes())


def decode(
    encoding: str,
    data: Buffer,
    stamp_ns: int,
    time_base_ns: int,
    width: int,
    height: int,
    is_bigendian: bool = False,
) -> Events:
    """Decode a packet by itself; the events keep the packet's order.

    Of the times that agree with the 24 bits of evt3, the first event's is the one nearest to
    the stamp, every other event's the one nearest to the event before. With a simulator's
    packets these are simulation times, wherever simulation time jumps. A camera's clock is not
    the stamp's, so with its packets the times are off, and differently every 16.8 s: use a
    Decoder. The other encodings count from the time base.

    Words of evt3 before the first time and row are skipped, as are triggers.

    Args:
        encoding: One of DECODABLE.
        data: The payload, anything with the buffer protocol.
        stamp_ns: Stamp in the packet's header.
        time_base_ns: The packet's time base.
        width: Columns of the sensor [px].
        height: Rows of the sensor [px].
        is_bigendian: The packet's flag: such packets are refused.

    Raises:
        PacketError: The packet is not what the encoding allows, an event is outside the sensor,
            or times decrease.
    """
    word_bytes = _check(encoding, stamp_ns, time_base_ns, width, height, is_bigendian)
    payload = check_payload(encoding, data, word_bytes)
    width, height = int(width), int(height)
    if encoding == 'evt3':
        anchor_us = int(stamp_ns) // 1000
        decoded = evt3.decode(payload, width, height, anchor_us, 0, evt3.new_state())
    else:
        decoded = _decode_from_time_base(encoding, payload, int(time_base_ns), width, height, 0)
    return _events(encoding, decoded, width, height)


class Decoder:
    """Decodes one camera's packets, one after the other, into sensor time.

    Where `decode` looks at a packet by itself, this keeps what evt3 carries from packet to
    packet (time, row) and counts how often its 24-bit time came round, as event_camera_codecs
    does: cameras begin their packets anywhere in the stream. A camera's time may go back a
    little within a packet (by 41 ms at most): such events are given the time of the one before.
    What is carried is forgotten when the stamp goes back, as in a replay or after a reset, or
    when encoding or size change.
    """

    def __init__(self) -> None:
        self._state = evt3.new_state()
        self._source = ('', 0, 0)
        self._stamp_ns = 0

    def decode(
        self,
        encoding: str,
        data: Buffer,
        stamp_ns: int,
        time_base_ns: int,
        width: int,
        height: int,
        is_bigendian: bool = False,
    ) -> Events:
        """Decode the next packet; arguments and errors as of the function `decode`.

        After an error, evt3 events are skipped until time and row are known again.
        """
        word_bytes = _check(encoding, stamp_ns, time_base_ns, width, height, is_bigendian)
        width, height = int(width), int(height)
        if stamp_ns < self._stamp_ns or self._source != (encoding, width, height):
            self._state = evt3.new_state()
            self._source = (encoding, width, height)
        self._stamp_ns = stamp_ns
        try:
            payload = check_payload(encoding, data, word_bytes)
            if encoding == 'evt3':
                decoded = evt3.decode(payload, width, height, evt3.NO_ANCHOR, BACK_US, self._state)
            else:
                decoded = _decode_from_time_base(
                    encoding, payload, int(time_base_ns), width, height, BACK_US
                )
            return _events(encoding, decoded, width, height)
        except PacketError:
            self.resynchronise()
            raise

    def resynchronise(self) -> None:
        """Skip evt3 events until time and row are known again: call it when packets were lost."""
        evt3.resynchronise(self._state)


def _check_events(events: Events) -> Events:
    """Return the events in the one kind of array that the kernels are compiled for."""
    # No event takes more than 8 bytes in either encoding.
    if events.dtype != EVENT_DTYPE or events.ndim != 1 or len(events) > MAX_BYTES // 8:
        raise PacketError(
            f'events: expected at most {MAX_BYTES // 8} of {EVENT_DTYPE.names} in one dimension, '
            f'got {events.dtype} of shape {events.shape}'
        )
    events = np.ascontiguousarray(events)[:]
    events.flags.writeable = False
    return events


def _check(
    encoding: str, stamp_ns: int, time_base_ns: int, width: int, height: int, is_bigendian: bool
) -> int:
    """Check what comes with the payload; return the bytes of a word."""
    layout = check_packet(encoding, stamp_ns, width, height)
    if not 0 <= time_base_ns < MAX_TIME_NS:
        raise PacketError(
            f'{encoding} packet: expected a time base of 0 to 2**62 ns, got {time_base_ns}'
        )
    if is_bigendian:
        raise PacketError(f'{encoding} packet: expected little-endian words, got big-endian ones')
    return layout.word_bytes


def _decode_from_time_base(
    encoding: str,
    payload: NDArray[np.uint8],
    time_base_ns: int,
    width: int,
    height: int,
    back_us: int,
) -> Decoded:
    if encoding == 'mono':
        decoded: Decoded = mono.decode(payload, width, height, time_base_ns, back_us * 1000)
    elif encoding == 'libcaer':
        decoded = libcaer.decode(payload, width, height, time_base_ns, back_us)
    else:
        decoded = libcaer_cmp.decode(payload, width, height, time_base_ns, back_us)
    return decoded


def _events(encoding: str, decoded: Decoded, width: int, height: int) -> Events:
    events, fault, index = decoded
    if fault != FINE:
        raise fault_error(encoding, fault, index, width, height)
    return events
