"""From a camera's events to steps: filtered, cropped, scaled, binned; see `sensor`."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from spikelane_sim.codecs import DecodedPacket, Decoder, STAMP_TOLERANCE_NS
from spikelane_sim.errors import ParameterError
from spikelane_sim.events import Events, no_events
from spikelane_sim.filters import FilterStage
from spikelane_sim.parameters import parameter, Parameters
from spikelane_sim.period import PERIOD_NS

SOURCES = ('auto', 'simulator', 'camera')


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
        'How packets become steps: each packet is one step (simulator), or packets are '
        'cropped, scaled and binned by time (camera). auto: simulator if there are lane '
        'states, or if the time base of the first packet is one step before its stamp; '
        'otherwise camera.',
        choices=SOURCES,
    )
    crop_left: int = parameter(
        -1,
        "First column of a camera's image that is used; -1: the columns in the middle are used.",
        unit='px',
        low=-1,
        high=65_535,
    )
    crop_top: int = parameter(
        -1,
        "First row of a camera's image that is used; -1: the rows in the middle are used.",
        unit='px',
        low=-1,
        high=65_535,
    )
    crop_width: int = parameter(
        0,
        "Number of columns of a camera's image that are used; the number of rows follows from "
        'the shape of the image that the controller needs; 0: as many columns as possible.',
        unit='px',
        low=0,
        high=65_535,
    )
    one_per_pixel: bool = parameter(
        True, "Keep only the first event of each pixel in a step of a camera's events."
    )
    longest_pause_s: float = parameter(
        1.0,
        "Steps restart if a camera's time, as its events or time words give it, advances by "
        'more than this at once.',
        unit='s',
        low=0.05,
        high=60.0,
    )
    stamp_tolerance_s: float = parameter(
        STAMP_TOLERANCE_NS / 1e9,
        "Steps restart if the stamp of a camera's packet is earlier than the latest stamp by "
        'more than this; clock synchronisation sets stamps back by less.',
        unit='s',
        low=0.0,
        high=3600.0,
    )

    @property
    def stamp_tolerance_ns(self) -> int:
        """How far stamps may go back [ns]."""
        return round(self.stamp_tolerance_s * 1e9)


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
        events: Events of the whole image, (N,).
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
    first_events: Events = events[first[pixels] == numbers]
    return first_events


class StepBinning:
    """The steps of one camera; they restart where its time jumps."""

    def __init__(
        self,
        parameters: SensorParameters,
        crop: Crop,
        width: int,
        height: int,
        restarts: Counter[str],
        stage: FilterStage,
        period_ns: int = PERIOD_NS,
    ) -> None:
        """Begin with nothing.

        Args:
            parameters: How packets become steps.
            crop: The part of the image that is used.
            width: Columns that it is scaled to [px].
            height: Rows that it is scaled to [px].
            restarts: Counts how often steps restart, by the reason.
            stage: The filters that events go through, of the whole image.
            period_ns: Length of a step.
        """
        self.decoder = Decoder(parameters.stamp_tolerance_ns)
        self._period_ns = period_ns
        self._restarts = restarts
        self._stage = stage
        self._crop, self._size = crop, (width, height)
        self._one_per_pixel = parameters.one_per_pixel
        self._pause_s = parameters.longest_pause_s
        self._pause_ns = round(parameters.longest_pause_s * 1e9)
        self._offset_ns: int | None = None  # from the sensor's time to that of the stamps
        self._latest_ns = 0  # how far time has come
        self._end_ns = 0  # of the step that is being gathered
        self._gathered: list[Events] = []

    @property
    def has_begun(self) -> bool:
        """Whether a step is being gathered."""
        return self._offset_ns is not None

    @property
    def unfinished_events(self) -> int:
        """Events of the whole image in the step that is being gathered."""
        return sum(map(len, self._gathered))

    def add(self, packet: DecodedPacket, stamp_ns: int) -> list[SensorStep]:
        """Take a packet in sensor time; return the steps that are complete with it."""
        steps: list[SensorStep] = []
        if len(packet.events):
            jumps = np.flatnonzero(np.diff(packet.events['t']) > self._pause_ns) + 1
            for piece in np.split(packet.events, jumps) if len(jumps) else (packet.events,):
                steps += self._add_piece(piece, stamp_ns)
        if packet.time_ns is not None:
            # A still scene has times without events, and its steps are complete all the same.
            self._begin_if_new(packet.time_ns, stamp_ns)
            self._latest_ns = max(self._latest_ns, self._stamped(packet.time_ns))
            while self._latest_ns >= self._end_ns:
                steps.append(self._complete())
        return steps

    def _add_piece(self, events: Events, stamp_ns: int) -> list[SensorStep]:
        self._begin_if_new(int(events['t'][0]), stamp_ns)
        # A camera's time may go back a little from packet to packet.
        times_ns = np.maximum(self._stamped(events['t']), self._latest_ns)
        self._latest_ns = int(times_ns[-1])
        stamped = events.copy()
        stamped['t'] = times_ns
        passed = self._stage.filter(stamped)
        times_ns = passed['t']
        steps: list[SensorStep] = []
        begin = 0
        while self._latest_ns >= self._end_ns:
            end = int(np.searchsorted(times_ns, self._end_ns))
            self._gathered.append(passed[begin:end])
            steps.append(self._complete())
            begin = end
        self._gathered.append(passed[begin:])
        return steps

    def _stamped(self, t_ns: Any) -> Any:
        """Return sensor times as times of the stamps."""
        return t_ns + self._offset_ns

    def _begin_if_new(self, t_ns: int, stamp_ns: int) -> None:
        """Begin steps at a sensor time if there are none yet, or if it is a jump."""
        begin_ns = stamp_ns
        if self._offset_ns is not None:
            ahead_ns = t_ns + self._offset_ns - self._latest_ns
            if -self._period_ns <= ahead_ns <= self._pause_ns:
                return
            self._restarts[
                "the sensor's time went back"
                if ahead_ns < 0
                else f"the sensor's time went on by more than {self._pause_s:g} s at once"
            ] += 1
            # Not back in time where a pause is inside a packet.
            begin_ns = max(stamp_ns, self._latest_ns)
        self._offset_ns = begin_ns - t_ns
        self._latest_ns, self._end_ns = begin_ns, begin_ns + self._period_ns
        self._gathered = []
        self._stage.reset()

    def _complete(self) -> SensorStep:
        events = no_events()
        if self._gathered:
            events = scale_events(np.concatenate(self._gathered), self._crop, *self._size)
        if self._one_per_pixel:
            events = first_per_pixel(events, *self._size)
        step = SensorStep(self._end_ns, events)
        self._end_ns += self._period_ns
        self._gathered = []
        return step
