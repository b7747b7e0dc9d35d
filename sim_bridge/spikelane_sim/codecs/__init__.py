"""Event packets: the bytes of `event_camera_msgs/msg/EventPacket`, to events and back."""

from spikelane_sim.codecs.packets import (
    decode,
    decode_packet,
    DecodedPacket,
    Decoder,
    encode,
    EncodedPacket,
    STAMP_TOLERANCE_NS,
)
from spikelane_sim.codecs.payload import DECODABLE, Dropped, ENCODABLE, MAX_BYTES, MAX_EVENTS

__all__ = [
    'DECODABLE',
    'ENCODABLE',
    'MAX_BYTES',
    'MAX_EVENTS',
    'STAMP_TOLERANCE_NS',
    'DecodedPacket',
    'Decoder',
    'Dropped',
    'EncodedPacket',
    'decode',
    'decode_packet',
    'encode',
]
