"""Events of one camera as another camera would see them, through the plane of the floor.

A policy was trained with one camera and drives with another, whose lens, height or direction
differ. All that both see is a flat floor. A ray through the centre of each pixel of the trained
camera meets the floor in a point, and one pixel of the camera at hand sees that point: its events
are those of the trained camera's pixel. That is the rule by which the simulated camera draws an
image (`camera`), so that an edge passes the pixels at the same times.

A pixel that sees the floor coarsely gives its events to several pixels of the trained camera; one
that sees it finely may give them to none. The table is made once.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spikelane_sim.calibration import Calibration, CalibrationError, read_calibration
from spikelane_sim.errors import ParameterError
from spikelane_sim.events import Events
from spikelane_sim.filters.kind import FilterKind
from spikelane_sim.parameters import parameter, Parameters


@dataclass(frozen=True, kw_only=True)
class GroundViewParameters(Parameters):
    """The camera at hand, and the one that the controller was trained with."""

    file: str = parameter(
        '', "File of the camera's calibration, as `spikelane camera` writes it; required."
    )
    trained_file: str = parameter(
        '',
        'File of the calibration of the camera that the controller was trained with; empty: the '
        "paper's camera on the P3-DX.",
    )
    look_ahead_m: float = parameter(
        0.0,
        'The floor seen this much farther ahead is taken for the floor that the trained camera '
        'sees. A narrow lens sees both edges of the lane only farther ahead than the trained '
        'camera does; in a curve the robot then drives nearer to the inside.',
        unit='m',
        low=-10.0,
        high=10.0,
    )


class GroundView:
    """Moves events to the image of the trained camera; an `EventMap`.

    Attributes:
        size: Width and height [px] of the trained camera's image.
        share: Share of the trained camera's pixels that see the floor whose point the camera at
            hand sees as well.
    """

    def __init__(self, parameters: GroundViewParameters, width: int, height: int) -> None:
        """Make the table.

        Args:
            parameters: The two cameras.
            width: Columns of the image [px].
            height: Rows of the image [px].

        Raises:
            SpikelaneError: A calibration cannot be used, is that of a camera of another size, or
                the two cameras see no point in common.
        """
        if not parameters.file:
            raise ParameterError(
                "filter.ground_view.file: expected the path of a camera's calibration, got ''"
            )
        camera = read_calibration(Path(parameters.file))
        if (camera.width, camera.height) != (width, height):
            raise CalibrationError(
                f'{parameters.file}: expected the calibration of a camera of {width} x {height} '
                f'px, got that of one of {camera.width} x {camera.height} px'
            )
        trained = _trained_camera(parameters.trained_file)
        self.size = trained.width, trained.height
        points = trained.floor_points()
        sources = camera.pixels_of(points + (parameters.look_ahead_m, 0.0))
        targets = np.flatnonzero(sources >= 0)
        if not len(targets):
            raise CalibrationError(
                f'{parameters.file}: expected a camera that sees some of the floor that the '
                'trained camera sees, got a camera that sees none of it'
            )
        self.share = len(targets) / np.count_nonzero(np.isfinite(points[:, 0]))
        by_source = targets[np.argsort(sources[targets], kind='stable')]
        self._rows, self._columns = np.divmod(by_source, trained.width)
        self._counts = np.bincount(sources[targets], minlength=width * height)
        self._starts = np.cumsum(self._counts) - self._counts
        self._width = width

    def reset(self) -> None:
        """No event is remembered."""

    def moved(self, events: Events) -> Events:
        """Return the events in the trained camera's image; see `EventMap`."""
        pixels = events['y'].astype(np.int64) * self._width + events['x']
        counts = self._counts[pixels]
        ends = np.cumsum(counts)
        moved = np.repeat(events, counts)
        places = np.arange(len(moved)) + np.repeat(self._starts[pixels] - ends + counts, counts)
        moved['x'], moved['y'] = self._columns[places], self._rows[places]
        ordered: Events = moved[np.lexsort((moved['x'], moved['y'], moved['t']))]
        return ordered


def _trained_camera(file: str) -> Calibration:
    """Return the camera of a file, or the paper's.

    Raises:
        CalibrationError: It cannot be read, or has a distorted lens.
    """
    if not file:
        # Here and not above: what simulates a robot is needed by few who filter events.
        from spikelane_sim.simulated_calibration import simulated_calibration
        from spikelane_sim.simulator_parameters import SimulatorParameters

        return simulated_calibration(SimulatorParameters())
    camera = read_calibration(Path(file))
    if camera.is_distorted:
        raise CalibrationError(
            f'{file}: expected a trained camera without distortion, got {camera.model} with '
            f'{list(camera.distortion)}'
        )
    return camera


GROUND_VIEW = FilterKind(GroundView, GroundViewParameters, moves_events=True)
