"""From the packets of any event camera to the steps that controllers are made for.

A simulator sends one packet per step of 50 ms, of the size its controllers expect: it is decoded
and taken as it is; one of another size is refused. A real camera knows nothing of steps, has
another size and a clock of its own:

1. Its packets are decoded one after the other into the sensor's time (`codecs.Decoder`).
2. The sensor's time is counted from the first event, and that from its packet's stamp: event at
   t_0 in a packet stamped s_0, so an event at t is at s_0 + t - t_0.
3. A part of the image, in the shape that is wanted and as large as it fits in the middle unless
   another one is asked for, is scaled: column x becomes floor((x - left) width / crop_width), row
   y likewise. What is outside is left out.
4. Step k has the events from s_0 + 50 k to s_0 + 50 (k + 1) ms, and that end for its stamp. It is
   complete when an event after its end is there, so that a step comes at most one packet late.
   Steps without events are steps too.
5. Of a pixel's events in a step only the first is kept, since the simulated pixel that
   controllers are made for fires at most once in a step.

Where the sensor's time goes back, or on by more than a longest pause, all this begins anew, and
what is there of a step is dropped.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numba

from spikelane_sim.binning import Bins, Crop, find_crop, SensorParameters, SensorStep
from spikelane_sim.codecs import decode
from spikelane_sim.codecs.payload import Buffer
from spikelane_sim.contract import STEP_NS
from spikelane_sim.errors import PacketError, ParameterError
from spikelane_sim.events import Events, no_events


class ReceivedPacket(NamedTuple):
    """An EventPacket, wherever it comes from."""

    stamp_ns: int
    sequence: int  # counts packets
    encoding: str
    data: Buffer
    time_base_ns: int
    width: int  # [px]
    height: int  # [px]
    is_bigendian: bool = False


class Sensor:
    """Makes steps of one camera's packets, as the module says.

    Attributes:
        packets: Taken.
        lost: Missing in the packets' numbering.
        faulty: Could not be decoded: a step without events, or nothing of a camera's step.
        first_fault: Why the first of them could not; '' without one.
        on: Events decoded that say brighter; 0 like the next three unless `sums_events`.
        off: Events decoded that say darker.
        sum_x: Sum of the columns of the events decoded [px].
        sum_y: Sum of their rows [px].
        kept: Events in the steps given.
        restarts: How often steps began anew.
        is_camera: Whether packets are taken as a camera's; None before the first.
    """

    def __init__(
        self,
        parameters: SensorParameters | None = None,
        *,
        width: int = 128,
        height: int = 128,
        has_lane: bool = False,
        any_size: bool = False,
        sums_events: bool = False,
        on_fault: Callable[[str], None] = lambda reason: None,
        on_loss: Callable[[int], None] = lambda count: None,
    ) -> None:
        """Begin with nothing.

        Args:
            parameters: How packets become steps.
            width: Columns of the image that is wanted [px].
            height: Rows of the image that is wanted [px].
            has_lane: Whether lane states come with the packets, as from a simulator.
            any_size: Whether a simulator's image may have another size, as nobody looks at it.
            sums_events: Whether on, off, sum_x and sum_y are kept, to compare with other decoders.
            on_fault: Told why a packet cannot be decoded.
            on_loss: Told how many packets are missing before one.

        Raises:
            ParameterError: A camera's packets are expected with lane states, which have no steps
                of a camera to go with.
        """
        self.parameters = parameters or SensorParameters()
        if has_lane and self.parameters.source == 'camera':
            raise ParameterError(
                'source: expected auto or simulator where lane states are used, got camera'
            )
        self._size = (width, height)
        self._has_lane, self._any_size, self._sums_events = has_lane, any_size, sums_events
        self._on_fault, self._on_loss = on_fault, on_loss
        self._source = ('', 0, 0)  # encoding, width, height
        self._stamp_ns = self._sequence = 0
        self._bins: Bins | None = None
        self.packets = self.lost = self.faulty = self.restarts = 0
        self.on = self.off = self.sum_x = self.sum_y = self.kept = 0
        self.first_fault = ''
        self.is_camera: bool | None = None

    def add(self, packet: ReceivedPacket) -> list[SensorStep]:
        """Take the next packet; return the steps that are complete with it.

        Raises:
            ParameterError: The part of the image asked for is not inside this camera's, or a
                simulator's image has not the size that is wanted.
        """
        source = packet.encoding, packet.width, packet.height
        # Another camera, or the same one that began anew.
        if source != self._source or packet.stamp_ns < self._stamp_ns:
            self._begin(packet)
        elif packet.sequence > self._sequence + 1:
            self._lose(packet.sequence - self._sequence - 1)
        self._source, self._stamp_ns, self._sequence = source, packet.stamp_ns, packet.sequence
        self.packets += 1
        steps = self._simulated(packet) if self._bins is None else self._binned(self._bins, packet)
        for step in steps:
            self.kept += len(step.events)
        return steps

    def _begin(self, packet: ReceivedPacket) -> None:
        """Find out what sends packets."""
        source = self.parameters.source
        is_step = packet.stamp_ns - packet.time_base_ns == STEP_NS
        self.is_camera = source == 'camera' or (
            source == 'auto' and not self._has_lane and not is_step
        )
        self._bins = None
        size = packet.width, packet.height
        has_size = all(size)  # none at all is for the decoder to complain about
        if self.is_camera:
            crop = Crop(0, 0, 1, 1)
            if has_size:
                crop = find_crop(packet.width, packet.height, self.parameters, *self._size)
            self._bins = Bins(self.parameters, crop, *self._size)
        elif has_size and size != self._size and not self._any_size:
            raise ParameterError(
                f"event packets: expected a simulator's image of {self._size[0]} x "
                f'{self._size[1]} px, as the controller wants, got {size[0]} x {size[1]} px; '
                "only a camera's is scaled"
            )

    def _lose(self, count: int) -> None:
        self.lost += count
        if self._bins is not None:
            self._bins.decoder.resynchronise()
        self._on_loss(count)

    def _simulated(self, packet: ReceivedPacket) -> list[SensorStep]:
        events = self._decoded(decode, packet)
        return [SensorStep(packet.stamp_ns, no_events() if events is None else events)]

    def _binned(self, bins: Bins, packet: ReceivedPacket) -> list[SensorStep]:
        events = self._decoded(bins.decoder.decode, packet)
        if events is None:
            return []
        before = bins.restarts
        steps = bins.add(events, packet.stamp_ns)
        self.restarts += bins.restarts - before
        return steps

    def _decoded(self, decode: Callable[..., Events], packet: ReceivedPacket) -> Events | None:
        """Return a packet's events, None where they cannot be decoded."""
        try:
            events = decode(
                packet.encoding,
                packet.data,
                packet.stamp_ns,
                packet.time_base_ns,
                packet.width,
                packet.height,
                packet.is_bigendian,
            )
        except PacketError as error:
            self.faulty += 1
            self.first_fault = self.first_fault or str(error)
            self._on_fault(str(error))
            return None
        if self._sums_events:
            self._count(events)
        return events

    def _count(self, events: Events) -> None:
        on, sum_x, sum_y = _sums(events)
        self.on += on
        self.off += len(events) - on
        self.sum_x += sum_x
        self.sum_y += sum_y


@numba.njit(cache=True)
def _sums(events: Events) -> tuple[int, int, int]:
    """Return how many events are ON, and the sums of columns and rows."""
    on, sum_x, sum_y = 0, 0, 0
    for event in events:
        on += event.polarity > 0
        sum_x += int(event.x)
        sum_y += int(event.y)
    return on, sum_x, sum_y
