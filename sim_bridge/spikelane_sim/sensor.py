"""From the packets of any event camera to the steps that controllers are made for.

A simulator sends one packet per step, of the size its controllers expect: it is decoded
and taken as it is; one of another size is refused. A real camera knows nothing of steps, has
another size and a clock of its own:

1. Its packets are decoded one after the other into the sensor's time (`codecs.Decoder`). What
   makes no sense costs only itself, and is counted.
2. The sensor's time is counted from the first event, and that from its packet's stamp: event at
   t_0 in a packet stamped s_0, so an event at t is at s_0 + t - t_0. (If packets with time words
   but without events come first, t_0 is the time that the first of them tells.)
3. Filters (`filters`) let some of the events pass, of the whole image and in the camera's own
   resolution. A simulator's events go through them, too.
4. Where one of them moves events to another image (`filters.ground_view`), that image is meant
   here. A part of the image, in the shape that is wanted and as large as it fits in the middle
   unless another one is asked for, is scaled: column x becomes
   floor((x - left) width / crop_width), row y likewise. What is outside is left out.
5. With a control period T, step k has the events from s_0 + k T to s_0 + (k + 1) T, and that end
   for its stamp. It is
   complete when the sensor's time has reached its end, which an event tells, or a time word of
   evt3 or libcaer_cmp without events. Steps without events are steps too, so that a controller
   goes on answering before a still scene. Where no packet comes at all there are no steps: the
   controller does not answer, and what it answered last holds for as long as the robot lets it.
6. Only the first of a pixel's events in a step is kept, since the simulated pixel that
   controllers are made for fires at most once in a step.

All this begins anew, and what is gathered of a step is dropped, where

- the packets have another encoding or size;
- a packet's number (`seq`) is smaller than the one before: the driver was started again;
- the sensor's time goes back by more than a step, or on by more than a longest pause at once;
- a stamp is earlier than the latest one by more than a tolerance (0.5 s unless another one is
  asked for). Stamps that go back by less change nothing: clock synchronisation does that.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

import numba

from spikelane_sim.binning import Crop, find_crop, SensorParameters, SensorStep, StepBinning
from spikelane_sim.codecs import decode_packet, DecodedPacket
from spikelane_sim.codecs.payload import Buffer, check_packet
from spikelane_sim.contract import LaneState
from spikelane_sim.errors import PacketError, ParameterError
from spikelane_sim.events import Events, no_events
from spikelane_sim.filters import FilterParameters, FilterStage
from spikelane_sim.period import PERIOD_NS


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

    def decoded_by(self, decode: Callable[..., DecodedPacket]) -> DecodedPacket:
        """Return what it holds.

        Args:
            decode: `codecs.decode_packet`, or the method of that name of a `Decoder`.

        Raises:
            PacketError: It cannot be decoded.
        """
        size = self.width, self.height
        return decode(
            self.encoding, self.data, self.stamp_ns, self.time_base_ns, *size, self.is_bigendian
        )


class Sensor:
    """Makes steps of one camera's packets, as the module says.

    Attributes:
        period_ns: Length of a step.
        packets: Taken.
        lost: Missing in the packets' numbering.
        faulty: Could not be decoded: a step without events, or nothing of a camera's step.
        reserved: Words that the encoding does not define; skipped.
        outside: Events outside the image; left out.
        mistimed: Events whose time does not fit those of the events around them; left out.
        on: Events decoded that say brighter; 0 like the next three unless `sums_events`.
        off: Events decoded that say darker.
        sum_x: Sum of the columns of the events decoded [px].
        sum_y: Sum of their rows [px].
        events_in_steps: Events in the steps that were returned.
        unfinished_packets: Packets since the one that completed the last step.
        is_camera: Whether packets are taken as a camera's; None before the first.
    """

    def __init__(
        self,
        parameters: SensorParameters | None = None,
        filters: FilterParameters | None = None,
        *,
        width: int = 128,
        height: int = 128,
        period_ns: int = PERIOD_NS,
        has_lane: bool = False,
        any_size: bool = False,
        sums_events: bool = False,
        on_fault: Callable[[str], None] = lambda reason: None,
        on_loss: Callable[[int], None] = lambda count: None,
    ) -> None:
        """Begin with nothing.

        Args:
            parameters: How packets become steps.
            filters: What events go through; None for no filter.
            width: Columns of the image that is wanted [px].
            height: Rows of the image that is wanted [px].
            period_ns: Length of a step.
            has_lane: Whether lane states come with the packets, as from a simulator.
            any_size: Whether a simulator's image may have another size, as nobody looks at it.
            sums_events: Whether on, off, sum_x and sum_y are kept, to compare with other decoders.
            on_fault: Called with the reason why a packet cannot be decoded.
            on_loss: Called with the number of packets missing before one.

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
        self.period_ns = period_ns
        self._has_lane, self._any_size, self._sums_events = has_lane, any_size, sums_events
        self._on_fault, self._on_loss = on_fault, on_loss
        self._filters = filters or FilterParameters()
        self._stage = FilterStage(FilterParameters(), width, height)  # until a packet has come
        self._stage_size: tuple[int, int] | None = None
        self._source = ('', 0, 0)  # encoding, width, height
        self._stamp_ns = self._sequence = 0
        self._binning: StepBinning | None = None
        self._restarts: Counter[str] = Counter()  # by reason
        self._faults: Counter[str] = Counter()  # by the first reason of each kind
        self.packets = self.lost = self.faulty = 0
        self.reserved = self.outside = self.mistimed = 0
        self.on = self.off = self.sum_x = self.sum_y = self.events_in_steps = 0
        self.unfinished_packets = 0
        self.is_camera: bool | None = None

    @property
    def events_in(self) -> int:
        """Events that came to the filters."""
        return self._stage.events_in

    @property
    def events_out(self) -> int:
        """Events that the filters let pass."""
        return self._stage.events_out

    @property
    def unfinished_events(self) -> int:
        """Events after the last complete step, filtered, not cropped; no step has them yet."""
        return 0 if self._binning is None else self._binning.unfinished_events

    @property
    def restarts(self) -> int:
        """How often the steps of a camera restarted."""
        return self._restarts.total()

    @property
    def first_fault(self) -> str:
        """Why the first packet that could not be decoded could not; '' without one."""
        return next(iter(self._faults), '')

    @property
    def notes(self) -> dict[str, str]:
        """What was odd, by its kind: a sentence each, with counts."""
        notes = {}
        for number, (reason, count) in enumerate(list(self._faults.items())):
            taken = 'left out' if self.is_camera else 'taken as empty'
            notes[f'faulty {number}'] = (
                f'{count} event packets cannot be decoded; {taken}: {reason}'
            )
        if self.reserved:
            notes['reserved'] = f'{self.reserved} reserved words in event packets were skipped'
        if self.outside:
            notes['outside'] = f'{self.outside} events outside the image were left out'
        if self.mistimed:
            notes['mistimed'] = (
                f'{self.mistimed} events whose times do not fit those around them were left out'
            )
        if self._restarts:
            reasons = '; '.join(f'{reason} ({n})' for reason, n in list(self._restarts.items()))
            notes['restarts'] = f"the camera's steps restarted (count: {self.restarts}): {reasons}"
        return notes

    def add(self, packet: ReceivedPacket, lane: LaneState | None = None) -> list[SensorStep]:
        """Take the next packet; return the steps that are complete with it.

        Args:
            packet: The packet.
            lane: The lane state that came with it, which tells the filters where an episode
                begins; None where there is none.

        Raises:
            ParameterError: The part of the image asked for is not inside this camera's, a
                simulator's image has not the size that is wanted, or a filter cannot be made for
                images of this size.
        """
        reason = self._reason_to_begin(packet)
        if reason is not None:
            if self._binning is not None and self._binning.has_begun:
                self._restarts[reason] += 1
            self._begin(packet)
        elif packet.sequence > self._sequence + 1:
            self._lose(packet.sequence - self._sequence - 1)
        self._stamp_ns, self._sequence = max(packet.stamp_ns, self._stamp_ns), packet.sequence
        self.packets += 1
        self._stage.begin_if_new(lane)
        if self._binning is None:
            steps = self._simulator_steps(packet)
        else:
            steps = self._camera_steps(self._binning, packet)
        self.unfinished_packets = 0 if steps else self.unfinished_packets + 1
        for step in steps:
            self.events_in_steps += len(step.events)
        return steps

    def _reason_to_begin(self, packet: ReceivedPacket) -> str | None:
        """Return why a packet does not continue those before, None if it does."""
        if self.is_camera is None:
            return 'the first packet'
        source = packet.encoding, packet.width, packet.height
        if source != self._source and (_is_possible(source) or not _is_possible(self._source)):
            return 'another encoding or image size'
        if packet.sequence < self._sequence:
            return "the packets' numbers went back"
        if packet.stamp_ns < self._stamp_ns - self.parameters.stamp_tolerance_ns:
            return f'the stamps went back by more than {self.parameters.stamp_tolerance_s:g} s'
        return None

    def _begin(self, packet: ReceivedPacket) -> None:
        """Find out what sends packets."""
        self._source = packet.encoding, packet.width, packet.height
        self._stamp_ns = packet.stamp_ns
        source = self.parameters.source
        is_step = packet.stamp_ns - packet.time_base_ns == self.period_ns
        self.is_camera = source == 'camera' or (
            source == 'auto' and not self._has_lane and not is_step
        )
        self._binning = None
        size = packet.width, packet.height
        has_size = all(size)  # none at all is for the decoder to complain about
        if self.is_camera:
            crop = Crop(0, 0, 1, 1)
            if has_size:
                self._make_stage(size)
                crop = find_crop(*self._stage.size, self.parameters, *self._size)
            self._stage.reset()
            self._binning = StepBinning(
                self.parameters, crop, *self._size, self._restarts, self._stage, self.period_ns
            )
            return
        if not has_size:
            return
        self._make_stage(size)
        if self._stage.size != self._size and not self._any_size:
            raise ParameterError(
                f"event packets: expected a simulator's image of {self._size[0]} x "
                f'{self._size[1]} px, as the controller wants, got {size[0]} x {size[1]} px; '
                "only a camera's is scaled"
            )

    def _make_stage(self, size: tuple[int, int]) -> None:
        """Make the filters for images of this size, unless they are for it already."""
        if size == self._stage_size:
            return
        before, self._stage_size = self._stage, size
        self._stage = FilterStage(self._filters, *size)
        self._stage.events_in, self._stage.events_out = before.events_in, before.events_out

    def _lose(self, count: int) -> None:
        self.lost += count
        if self._binning is not None:
            self._binning.decoder.resynchronise()
        self._on_loss(count)

    def _simulator_steps(self, packet: ReceivedPacket) -> list[SensorStep]:
        decoded = self._decoded(decode_packet, packet)
        events = no_events() if decoded is None else self._stage.filter(decoded.events)
        return [SensorStep(packet.stamp_ns, events)]

    def _camera_steps(self, binning: StepBinning, packet: ReceivedPacket) -> list[SensorStep]:
        decoded = self._decoded(binning.decoder.decode_packet, packet)
        return [] if decoded is None else binning.add(decoded, packet.stamp_ns)

    def _decoded(
        self, decode: Callable[..., DecodedPacket], packet: ReceivedPacket
    ) -> DecodedPacket | None:
        """Return what a packet holds, None where it cannot be decoded."""
        try:
            decoded = packet.decoded_by(decode)
        except PacketError as error:
            self._note_fault(str(error))
            return None
        self.reserved += decoded.dropped.reserved
        self.outside += decoded.dropped.outside
        self.mistimed += decoded.dropped.mistimed
        if self._sums_events:
            self._count(decoded.events)
        return decoded

    def _note_fault(self, reason: str) -> None:
        self.faulty += 1
        kind = reason.partition(', got ')[0]
        of_kind = (each for each in self._faults if each.partition(', got ')[0] == kind)
        first = next(of_kind, reason)
        # What came may differ in each packet: the kinds are few, but not what comes.
        self._faults[first] += 1
        self._on_fault(reason)

    def _count(self, events: Events) -> None:
        on, sum_x, sum_y = _sums(events)
        self.on += on
        self.off += len(events) - on
        self.sum_x += sum_x
        self.sum_y += sum_y


def _is_possible(source: tuple[str, int, int]) -> bool:
    """Return whether there are packets of this encoding, width and height."""
    encoding, width, height = source
    try:
        check_packet(encoding, 0, width, height)
    except PacketError:
        return False
    return True


@numba.njit(cache=True)
def _sums(events: Events) -> tuple[int, int, int]:
    """Return how many events are ON, and the sums of columns and rows."""
    on, sum_x, sum_y = 0, 0, 0
    for event in events:
        on += event.polarity > 0
        sum_x += int(event.x)
        sum_y += int(event.y)
    return on, sum_x, sum_y
