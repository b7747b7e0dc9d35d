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
    Dropped,
    ENCODABLE,
    fault_error,
    FINE,
    MAX_BYTES,
    MAX_TIME_NS,
    NO_TIME,
)
from spikelane_sim.errors import PacketError
from spikelane_sim.events import EVENT_DTYPE, Events
from spikelane_sim.period import PERIOD_NS

#: A stamp may be this much earlier than the latest one before a camera's stream begins anew [ns].
STAMP_TOLERANCE_NS = 500_000_000

_NOTHING = Dropped()


class EncodedPacket(NamedTuple):
    """What an EventPacket has in addition to its header and counter, always little endian."""

    encoding: str
    width: int  # [px]
    height: int  # [px]
    time_base_ns: int
    data: bytes


def encode(
    encoding: str,
    events: Events,
    stamp_ns: int,
    width: int,
    height: int,
    period_ns: int = PERIOD_NS,
) -> EncodedPacket:
    """Encode the events of one step.

    The time base is the start of the step that the stamp ends, or the first event's time if that
    is earlier. An evt3 packet begins with both time words, so that it can be read by itself, and
    has every TIME_HIGH from there to its stamp, so that packets joined one after the other make a
    raw file.

    Args:
        encoding: 'evt3' (times in whole microseconds) or 'mono'.
        events: Array of EVENT_DTYPE in the order of time, (N,); the order is kept.
        stamp_ns: The packet's stamp: simulation time at the end of the step.
        width: Columns of the sensor [px].
        height: Rows of the sensor [px].
        period_ns: Length of a step.

    Raises:
        PacketError: The events are not valid for this sensor, or their times are more than the
            encoding reaches (evt3: 8.3 s from the stamp, mono: 4.2 s from the time base).
    """
    check_packet(encoding, stamp_ns, width, height)
    if encoding not in ENCODABLE:
        raise PacketError(f'event packet: expected to encode {ENCODABLE}, got {encoding!r}')
    events = _check_events(events)
    width, height, stamp_ns = int(width), int(height), int(stamp_ns)
    begin_ns = max(0, stamp_ns - period_ns)
    if len(events):
        begin_ns = min(begin_ns, int(events[0]['t']))
    base_ns = max(0, begin_ns)
    if encoding == 'evt3':
        words, fault, index = evt3.encode(
            events, width, height, begin_ns // 1000, stamp_ns // 1000
        )
    else:
        words = np.empty(len(events), np.uint64)
        _, fault, index = mono.encode(events, width, height, base_ns, words)
    if fault != FINE:
        raise fault_error(encoding, fault, index, width, height)
    return EncodedPacket(encoding, width, height, base_ns, words.tobytes())


class DecodedPacket(NamedTuple):
    """What a packet holds.

    Attributes:
        events: In the order of time.
        dropped: What was left out.
        time_ns: The time of the packet's last time word, None where it has none: how far the
            sensor's time has come, with events or without.
    """

    events: Events
    dropped: Dropped
    time_ns: int | None


def decode(
    encoding: str,
    data: Buffer,
    stamp_ns: int,
    time_base_ns: int,
    width: int,
    height: int,
    is_bigendian: bool = False,
) -> Events:
    """Decode a packet by itself and return its events; see `decode_packet`."""
    return decode_packet(
        encoding, data, stamp_ns, time_base_ns, width, height, is_bigendian
    ).events


def decode_packet(
    encoding: str,
    data: Buffer,
    stamp_ns: int,
    time_base_ns: int,
    width: int,
    height: int,
    is_bigendian: bool = False,
) -> DecodedPacket:
    """Decode a packet by itself; the events keep the packet's order.

    Several times agree with the 24 bits of evt3. The first event's is the one that is nearest to
    the stamp, every other event's the one nearest to the event before. With a simulator's
    packets these are simulation times, wherever simulation time jumps. A camera's clock is not
    the stamp's, so with its packets the times are off, and differently every 16.8 s: use a
    Decoder. The other encodings count from the time base.

    What makes no sense costs only itself, and is counted: reserved words are skipped, events
    outside the sensor are left out, and so are events whose time is more than 45 ms before or
    after that of those around them (one that is earlier by less is given the time of the one
    before). Words of evt3 before the first time and row are skipped, as are triggers.

    Args:
        encoding: One of DECODABLE.
        data: The payload, anything with the buffer protocol.
        stamp_ns: Stamp in the packet's header.
        time_base_ns: The packet's time base.
        width: Columns of the sensor [px].
        height: Rows of the sensor [px].
        is_bigendian: The packet's flag: such packets are refused.

    Raises:
        PacketError: Nothing in the packet can be understood: an unknown encoding, a size that
            the encoding cannot hold, half a word, or more events than MAX_EVENTS.
    """
    word_bytes = _check(encoding, stamp_ns, time_base_ns, width, height, is_bigendian)
    payload = check_payload(encoding, data, word_bytes)
    width, height = int(width), int(height)
    if encoding == 'evt3':
        decoded = evt3.decode(payload, width, height, int(stamp_ns) // 1000, evt3.new_state())
    else:
        decoded = _decode_from_time_base(encoding, payload, int(time_base_ns), width, height)
    return _decoded_packet(encoding, decoded, int(time_base_ns), width, height)


class Decoder:
    """Decodes one camera's packets, one after the other, into sensor time.

    Where `decode` looks at a packet by itself, this keeps what evt3 carries from packet to
    packet (time, row) and counts how often its 24-bit time came round, as event_camera_codecs
    does: cameras begin their packets anywhere in the stream. What is carried is forgotten when
    encoding or size change, or when a stamp is earlier than the latest one by more than a
    tolerance, as in a replay that is repeated. A stamp that goes back by less changes nothing:
    clock synchronisation does that.
    """

    def __init__(self, stamp_tolerance_ns: int = STAMP_TOLERANCE_NS) -> None:
        """Begin with nothing; stamps may go back by the tolerance."""
        self._tolerance_ns = stamp_tolerance_ns
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
        """Decode the next packet and return its events; see `decode_packet`."""
        return self.decode_packet(
            encoding, data, stamp_ns, time_base_ns, width, height, is_bigendian
        ).events

    def decode_packet(
        self,
        encoding: str,
        data: Buffer,
        stamp_ns: int,
        time_base_ns: int,
        width: int,
        height: int,
        is_bigendian: bool = False,
    ) -> DecodedPacket:
        """Decode the next packet; arguments and errors as of the function `decode_packet`.

        After an error the time goes on; evt3 events are skipped until the row is known again.
        """
        try:
            word_bytes = _check(encoding, stamp_ns, time_base_ns, width, height, is_bigendian)
            payload = check_payload(encoding, data, word_bytes)
            width, height = int(width), int(height)
            self._note_source((encoding, width, height), int(stamp_ns))
            if encoding == 'evt3':
                decoded = evt3.decode(payload, width, height, evt3.NO_ANCHOR, self._state)
            else:
                decoded = _decode_from_time_base(
                    encoding, payload, int(time_base_ns), width, height
                )
            return _decoded_packet(encoding, decoded, int(time_base_ns), width, height)
        except PacketError:
            evt3.forget_place(self._state)
            raise

    def resynchronise(self) -> None:
        """Skip evt3 events until time and row are known again: call it when packets were lost."""
        evt3.resynchronise(self._state)

    def _note_source(self, source: tuple[str, int, int], stamp_ns: int) -> None:
        if self._source != source or stamp_ns < self._stamp_ns - self._tolerance_ns:
            self._state = evt3.new_state()
            self._source, self._stamp_ns = source, stamp_ns
        elif stamp_ns > self._stamp_ns:
            self._stamp_ns = stamp_ns


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
    encoding: str, payload: NDArray[np.uint8], time_base_ns: int, width: int, height: int
) -> Decoded:
    if encoding == 'mono':
        decoded: Decoded = mono.decode(payload, width, height, time_base_ns)
    elif encoding == 'libcaer':
        decoded = libcaer.decode(payload, width, height, time_base_ns)
    else:
        decoded = libcaer_cmp.decode(payload, width, height, time_base_ns)
    return decoded


def _decoded_packet(
    encoding: str, decoded: Decoded, time_base_ns: int, width: int, height: int
) -> DecodedPacket:
    events, fault, reserved, outside, mistimed, last_time_word_us = decoded
    if fault:
        raise fault_error(encoding, fault, 0, width, height)
    is_whole = not (reserved or outside or mistimed)
    dropped = _NOTHING if is_whole else Dropped(reserved, outside, mistimed)
    if last_time_word_us == NO_TIME:
        return DecodedPacket(events, dropped, None)
    return DecodedPacket(
        events, dropped, last_time_word_us * 1000 + (0 if encoding == 'evt3' else time_base_ns)
    )
