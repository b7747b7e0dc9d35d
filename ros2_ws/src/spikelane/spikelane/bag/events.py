"""All events of one camera in a recording, in the sensor's time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spikelane.bag.drive import RecordedDrive
from spikelane_sim.codecs import Decoder
from spikelane_sim.errors import BagError, PacketError
from spikelane_sim.events import Events, no_events


class RecordedEvents(NamedTuple):
    """What a camera saw."""

    events: Events  # of the whole image, in the order in which they were sent
    width: int  # columns of the image [px]
    height: int  # rows of the image [px]
    duration_s: float  # from the first event to the last, by the sensor's time


def recorded_events(drive: RecordedDrive) -> RecordedEvents:
    """Read the events of a recording; what cannot be decoded is left out.

    Raises:
        BagError: There are fewer than two events at different times, or the size of the image
            changes.
    """
    decoder = Decoder()
    found: list[Events] = [no_events()]
    size: tuple[int, int] | None = None
    for recorded in drive.packets():
        packet = recorded.packet
        try:
            decoded = packet.decoded_by(decoder.decode_packet)
        except PacketError:
            continue
        if size not in (None, (packet.width, packet.height)):
            raise BagError(
                f'event packets: expected images of one size, got {size} and '
                f'{(packet.width, packet.height)} px'
            )
        size = packet.width, packet.height
        found.append(decoded.events)
    events = np.concatenate(found)
    if size is None or len(events) < 2 or events['t'][-1] <= events['t'][0]:
        raise BagError('event packets: expected events at different times, got none')
    return RecordedEvents(events, *size, float(events['t'][-1] - events['t'][0]) / 1e9)
