"""From the packets of any event camera to the steps that controllers are made for.

A simulator sends one packet per step of 50 ms, of the size its controllers expect: it is decoded
and taken as it is. A real camera knows nothing of steps, has another size and a clock of its own:

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
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from spikelane_sim.codecs import decode, Decoder
from spikelane_sim.codecs.payload import Buffer
from spikelane_sim.contract import STEP_NS
from spikelane_sim.errors import PacketError, ParameterError
from spikelane_sim.events import Events, no_events
from spikelane_sim.parameters import parameter, Parameters

SOURCES = ('auto', 'simulator', 'camera')


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


class SensorStep(NamedTuple):
    """What the camera saw in one step."""

    stamp_ns: int  # the step's end
    events: Events  # in the order of time


class Crop(NamedTuple):
    """A part of the image."""

    left: int  # first column [px]
    top: int  # first row [px]
    width: int  # [px]
    height: int  # [px]


@dataclass(frozen=True, kw_only=True)
class SensorParameters(Parameters):
    """How event packets become steps."""

    source: str = parameter(
        'auto',
        'Whether a packet is a step (simulator), or packets are cropped, scaled and binned by '
        'time (camera). auto: a simulator where there are lane states, or where the time base of '
        'the first packet is one step before its stamp.',
        choices=SOURCES,
    )
    crop_left: int = parameter(
        -1, "First column of a camera's image that is used; -1: in the middle.", unit='px', low=-1
    )
    crop_top: int = parameter(
        -1, "First row of a camera's image that is used; -1: in the middle.", unit='px', low=-1
    )
    crop_width: int = parameter(
        0,
        "Columns of a camera's image that are used, the rows by the shape that is wanted; "
        '0: as many as there are.',
        unit='px',
        low=0,
    )
    one_per_pixel: bool = parameter(
        True, "Keep only the first event of each pixel in a step of a camera's events."
    )
    longest_pause_s: float = parameter(
        1.0,
        'Steps begin anew where a camera has no event for longer.',
        unit='s',
        low=0.05,
        high=60.0,
    )


def find_crop(
    width: int, height: int, parameters: SensorParameters, to_width: int, to_height: int
) -> Crop:
    """Return the part of a camera's image that is scaled.

    Args:
        width: Columns of the camera [px].
        height: Rows of the camera [px].
        parameters: Which part is asked for.
        to_width: Columns it is scaled to [px].
        to_height: Rows it is scaled to [px].

    Raises:
        ParameterError: It is not inside the image.
    """
    crop_width = parameters.crop_width or min(width, height * to_width // to_height)
    crop_height = crop_width * to_height // to_width
    left = parameters.crop_left if parameters.crop_left >= 0 else (width - crop_width) // 2
    top = parameters.crop_top if parameters.crop_top >= 0 else (height - crop_height) // 2
    is_inside = 0 <= left <= width - crop_width and 0 <= top <= height - crop_height
    if not is_inside or crop_width < 1 or crop_height < 1:
        raise ParameterError(
            f'crop_left, crop_top, crop_width: expected a part of {width} x {height} px, '
            f'got {crop_width} x {crop_height} px from ({left}, {top}) on'
        )
    return Crop(left, top, crop_width, crop_height)


def scale_events(events: Events, crop: Crop, to_width: int, to_height: int) -> Events:
    """Return the events inside a part of the image, scaled to another size.

    Args:
        events: Of the whole image, (N,).
        crop: The part.
        to_width: Columns of the result [px].
        to_height: Rows of the result [px].

    Returns:
        The events inside, in their order, (M,).
    """
    x, y = events['x'].astype(np.int64) - crop.left, events['y'].astype(np.int64) - crop.top
    inside = (x >= 0) & (x < crop.width) & (y >= 0) & (y < crop.height)
    scaled = events[inside]
    scaled['x'] = x[inside] * to_width // crop.width
    scaled['y'] = y[inside] * to_height // crop.height
    return scaled


def first_per_pixel(events: Events, width: int, height: int) -> Events:
    """Return the first event of each pixel of an image, in their order."""
    pixels = events['y'].astype(np.int64) * width + events['x']
    numbers = np.arange(len(events))
    first = np.empty(width * height, np.int64)
    first[pixels[::-1]] = numbers[::-1]  # of several values, the last one stays
    kept: Events = events[first[pixels] == numbers]
    return kept


class Sensor:
    """Makes steps of one camera's packets, as the module says.

    Attributes:
        packets: Taken.
        lost: Missing in the packets' numbering.
        faulty: Could not be decoded: a step without events, or nothing of a camera's step.
        on: Events decoded that say brighter.
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
        on_fault: Callable[[str], None] = lambda reason: None,
        on_loss: Callable[[int], None] = lambda count: None,
    ) -> None:
        """Begin with nothing.

        Args:
            parameters: How packets become steps.
            width: Columns of the image that is wanted [px].
            height: Rows of the image that is wanted [px].
            has_lane: Whether lane states come with the packets, as from a simulator.
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
        self._has_lane = has_lane
        self._on_fault, self._on_loss = on_fault, on_loss
        self._last: ReceivedPacket | None = None
        self._bins: _Bins | None = None
        self.packets = self.lost = self.faulty = self.restarts = 0
        self.on = self.off = self.sum_x = self.sum_y = self.kept = 0
        self.is_camera: bool | None = None

    def add(self, packet: ReceivedPacket) -> list[SensorStep]:
        """Take the next packet; return the steps that are complete with it.

        Raises:
            ParameterError: The part of the image asked for is not inside this camera's.
        """
        last, self._last = self._last, packet._replace(data=b'')
        if last is None or _is_other(packet, last):
            self._begin(packet)
        elif packet.sequence > last.sequence + 1:
            self._lose(packet.sequence - last.sequence - 1)
        self.packets += 1
        steps = self._simulated(packet) if self._bins is None else self._binned(self._bins, packet)
        self.kept += sum(len(step.events) for step in steps)
        return steps

    def _begin(self, packet: ReceivedPacket) -> None:
        """Find out what sends packets."""
        source = self.parameters.source
        is_step = packet.stamp_ns - packet.time_base_ns == STEP_NS
        self.is_camera = source == 'camera' or (
            source == 'auto' and not self._has_lane and not is_step
        )
        self._bins = None
        if self.is_camera:
            crop = Crop(0, 0, 1, 1)
            # No size at all is for the decoder to complain about.
            if packet.width and packet.height:
                crop = find_crop(packet.width, packet.height, self.parameters, *self._size)
            self._bins = _Bins(self.parameters, crop, *self._size)

    def _lose(self, count: int) -> None:
        self.lost += count
        if self._bins is not None:
            self._bins.decoder.resynchronise()
        self._on_loss(count)

    def _simulated(self, packet: ReceivedPacket) -> list[SensorStep]:
        try:
            events = decode(**_arguments(packet))
        except PacketError as error:
            self._fail(error)
            events = no_events()
        self._count(events)
        return [SensorStep(packet.stamp_ns, events)]

    def _binned(self, bins: _Bins, packet: ReceivedPacket) -> list[SensorStep]:
        try:
            events = bins.decoder.decode(**_arguments(packet))
        except PacketError as error:
            self._fail(error)
            return []
        self._count(events)
        before = bins.restarts
        steps = bins.add(events, packet.stamp_ns)
        self.restarts += bins.restarts - before
        return steps

    def _fail(self, error: PacketError) -> None:
        self.faulty += 1
        self._on_fault(str(error))

    def _count(self, events: Events) -> None:
        on = int(np.count_nonzero(events['polarity'] > 0))
        self.on += on
        self.off += len(events) - on
        self.sum_x += int(events['x'].sum(dtype=np.int64))
        self.sum_y += int(events['y'].sum(dtype=np.int64))


class _Bins:
    """The steps of one camera; where its time jumps they begin anew."""

    def __init__(self, parameters: SensorParameters, crop: Crop, width: int, height: int) -> None:
        self.decoder = Decoder()
        self.restarts = 0
        self._crop, self._size = crop, (width, height)
        self._one_per_pixel = parameters.one_per_pixel
        self._pause_ns = round(parameters.longest_pause_s * 1e9)
        self._offset_ns: int | None = None  # from the sensor's time to that of the stamps
        self._latest_ns = 0  # time of the last event
        self._end_ns = 0  # of the step that is being gathered
        self._gathered: list[Events] = []

    def add(self, events: Events, stamp_ns: int) -> list[SensorStep]:
        """Take events in sensor time, in the order of time; return the steps that are complete."""
        jumps = np.flatnonzero(np.diff(events['t']) > self._pause_ns) + 1
        steps: list[SensorStep] = []
        for piece in np.split(events, jumps):
            if len(piece):
                steps += self._add_piece(piece, stamp_ns)
        return steps

    def _add_piece(self, events: Events, stamp_ns: int) -> list[SensorStep]:
        first_ns = int(events['t'][0])
        if self._offset_ns is None or self._jumps(first_ns + self._offset_ns):
            self.restarts += self._offset_ns is not None
            # Not back in time where a pause is inside a packet.
            begin_ns = stamp_ns if self._offset_ns is None else max(stamp_ns, self._latest_ns)
            self._offset_ns = begin_ns - first_ns
            self._latest_ns, self._end_ns = begin_ns, begin_ns + STEP_NS
            self._gathered = []
        # A camera's time may go back a little from packet to packet.
        times_ns = np.maximum(events['t'] + self._offset_ns, self._latest_ns)
        self._latest_ns = int(times_ns[-1])
        scaled = events.copy()
        scaled['t'] = times_ns
        steps: list[SensorStep] = []
        begin = 0
        while self._latest_ns >= self._end_ns:
            end = int(np.searchsorted(times_ns, self._end_ns))
            self._gathered.append(scaled[begin:end])
            steps.append(self._complete())
            begin = end
        self._gathered.append(scaled[begin:])
        return steps

    def _jumps(self, t_ns: int) -> bool:
        return not -STEP_NS <= t_ns - self._latest_ns <= self._pause_ns

    def _complete(self) -> SensorStep:
        events = scale_events(np.concatenate(self._gathered), self._crop, *self._size)
        if self._one_per_pixel:
            events = first_per_pixel(events, *self._size)
        step = SensorStep(self._end_ns, events)
        self._end_ns += STEP_NS
        self._gathered = []
        return step


def _is_other(packet: ReceivedPacket, last: ReceivedPacket) -> bool:
    """Return whether a packet is of another camera, or of the same one that began anew."""
    return (packet.encoding, packet.width, packet.height) != (
        last.encoding,
        last.width,
        last.height,
    ) or packet.stamp_ns < last.stamp_ns


def _arguments(packet: ReceivedPacket) -> dict[str, Any]:
    """Return a packet as the decoders' arguments."""
    arguments = packet._asdict()
    del arguments['sequence']
    return arguments
