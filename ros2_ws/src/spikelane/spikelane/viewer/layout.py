"""Which views the page of the viewer has, and where."""

from __future__ import annotations

from typing import Any, TYPE_CHECKING

import numpy as np

from spikelane_sim import topic_names

if TYPE_CHECKING:
    from numpy.typing import NDArray

TIMELINE = 'simulation'

_DARK, _BLACK = (32, 38, 45), (0, 0, 0)  # behind the course, where markings are white; the camera
_AROUND_M = 0.4  # of the course in its view


def blueprint(around: NDArray[np.float64] | None, *, is_recorded: bool) -> Any:
    """Return which views there are and where.

    Args:
        around: Points of the page that the view of the course shows, (n, 2); None where they are
            not known.
        is_recorded: Whether all is there, to be played.
    """
    import rerun.blueprint as views

    bounds = None
    if around is not None:
        (left, top), (right, bottom) = around.min(axis=0), around.max(axis=0)
        bounds = views.VisualBounds2D(
            x_range=(left - _AROUND_M, right + _AROUND_M),
            y_range=(top - _AROUND_M, bottom + _AROUND_M),
        )
    return views.Blueprint(
        views.Horizontal(
            views.Vertical(
                views.Spatial2DView(
                    origin='course', name='Course', background=_DARK, visual_bounds=bounds
                ),
                views.TimeSeriesView(origin='lane', name='Distance from the lane centre [m]'),
                row_shares=[2, 1],
            ),
            views.Vertical(
                views.Spatial2DView(origin='camera/image', name='Camera image', background=_BLACK),
                views.Spatial2DView(
                    origin='camera/events', name='Events of a step', background=_BLACK
                ),
            ),
            views.Vertical(
                views.TimeSeriesView(origin='controller/spikes', name='Spikes of a step'),
                views.Spatial2DView(origin=topic_names.WEIGHTS, name='Weights'),
                views.TimeSeriesView(
                    origin='controller', contents='$origin/reward', name='Reward'
                ),
            ),
            column_shares=[5, 3, 3],
        ),
        views.TimePanel(
            state='expanded' if is_recorded else 'collapsed',
            timeline=TIMELINE,
            play_state='playing' if is_recorded else 'following',
        ),
        collapse_panels=True,
    )
