"""The one event type: what a pixel of the event camera reports.

Row 0 is the image's top row and column 0 its left one, as everywhere in ROS. Events are kept in
the order of time, then row, then column. Times are whole microseconds (the resolution of a DVS
and of evt3), stored in nanoseconds.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
