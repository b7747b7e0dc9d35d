"""Values that a figure tells when the pointer is over them; in SVG files, PNG files lack them.

Each is a transparent rectangle above the drawing, with a `title`, which browsers show by
themselves. The figure itself looks the same with and without them.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple, TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Class of the group of rectangles of one pair of axes.
GROUP = 'values'

_ABOVE_ALL = 1000  # order of drawing
_SPOT_PT = 9.0  # side of the rectangle of a point


class Value(NamedTuple):
    """What is told of a part of some axes.

    Attributes:
        text: What is told.
        x: From where to where along the x axis, in units of the data; equal for a point.
        y: Along the y axis; None for all of its height.
    """

    text: str
    x: tuple[float, float]
    y: tuple[float, float] | None = None


def tell_values(axes: Axes, values: Iterable[Value]) -> None:
    """Let axes tell values when they are saved as SVG, at the scales that they have then."""
    from matplotlib.artist import Artist

    told = tuple(values)

    class Values(Artist):
        """The rectangles."""

        def draw(self, renderer: Any) -> None:
            # Other renderers draw pictures without a pointer.
            if told and renderer.__class__.__name__ == 'MixedModeRenderer':
                _write(renderer, axes, told)

    artist = Values()
    artist.set_zorder(_ABOVE_ALL)
    axes.add_artist(artist)
    artist.set_clip_on(False)


def _write(renderer: Any, axes: Axes, values: Iterable[Value]) -> None:
    writer = renderer.writer
    look = {'fill': 'none', 'stroke': 'none', 'pointer-events': 'all', 'class': GROUP}
    group = writer.start('g', attrib=look)
    for text, (left, right), y in values:
        bottom, top = axes.get_ylim() if y is None else y
        corners = axes.transData.transform([(left, bottom), (right, top)])
        (x0, x1), (y0, y1) = (_widened(ends) for ends in corners.T.tolist())
        _, height = renderer.get_canvas_width_height()
        # Rows of an SVG file count from the top.
        place = {'x': x0, 'y': height - y1, 'width': x1 - x0, 'height': y1 - y0}
        writer.start('rect', attrib={name: f'{value:.1f}' for name, value in place.items()})
        writer.element('title', text)
        writer.end('rect')
    writer.close(group)


def _widened(ends: list[float]) -> tuple[float, float]:
    """Return the ends in order, those of a point so far apart that a pointer meets it."""
    low, high = sorted(ends)
    missing = max(_SPOT_PT - (high - low), 0.0) if high - low < 1.0 else 0.0
    return low - missing / 2, high + missing / 2
