"""Event packets: the bytes of `event_camera_msgs/msg/EventPacket`, to events and back."""

from spikelane_sim.codecs.packets import decode, Decoder, encode, EncodedPacket
from spikelane_sim.codecs.payload import DECODABLE, ENCODABLE, MAX_BYTES, MAX_EVENTS

__all__ = [
    'DECODABLE',
    'ENCODABLE',
    'MAX_BYTES',
    'MAX_EVENTS',
    'Decoder',
    'EncodedPacket',
    'decode',
    'encode',
]
