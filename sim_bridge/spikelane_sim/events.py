"""The one event type: what a pixel of the event camera reports.

Row 0 is the image's top row and column 0 its left one, as everywhere in ROS. Events are kept in
the order of time, then row, then column. Times are whole microseconds (the resolution of a DVS
and of evt3), stored in nanoseconds.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spikelane_sim.errors import PacketError

#: t [ns] simulation time; x, y [px]; polarity +1 brighter (ON), -1 darker (OFF).
EVENT_DTYPE = np.dtype([('t', '<i8'), ('x', '<u2'), ('y', '<u2'), ('polarity', 'i1')])

Events = NDArray[np.void]


def no_events() -> Events:
    """Return an empty array of events."""
    return np.empty(0, EVENT_DTYPE)


def make_events(t_ns: ArrayLike, x_px: ArrayLike, y_px: ArrayLike, polarity: ArrayLike) -> Events:
    """Make an array of events from columns of equal length (scalars are repeated).

    Args:
        t_ns: Times [ns], (N,).
        x_px: Columns [px], (N,).
        y_px: Rows [px], (N,).
        polarity: +1 or -1, (N,).
    """
    columns = np.broadcast_arrays(t_ns, x_px, y_px, polarity)
    events = np.empty(columns[0].shape, EVENT_DTYPE)
    for name, column in zip(EVENT_DTYPE.names or (), columns, strict=True):
        events[name] = column
    return events


def check_events(events: Events, width: int, height: int) -> None:
    """Check that events are what every part of Spikelane relies on.

    Args:
        events: Array of EVENT_DTYPE, (N,).
        width: Columns of the sensor [px].
        height: Rows of the sensor [px].

    Raises:
        PacketError: Wrong type, a coordinate outside the sensor, a polarity that is not +1 or
            -1, or times that decrease.
    """
    if events.dtype != EVENT_DTYPE or events.ndim != 1:
        raise PacketError(
            f'events: expected a one-dimensional array of {EVENT_DTYPE.names}, '
            f'got {events.dtype} of shape {events.shape}'
        )
    if not len(events):
        return
    if events['x'].max() >= width or events['y'].max() >= height:
        raise PacketError(
            f'events: expected coordinates inside {width} x {height} px, '
            f'got up to ({events["x"].max()}, {events["y"].max()})'
        )
    if not np.all(np.abs(events['polarity']) == 1):
        raise PacketError('events: expected polarities of +1 or -1')
    if np.any(np.diff(events['t']) < 0):
        raise PacketError('events: expected times that do not decrease')
