"""Frames and the transforms between them, as ROS publishes them on `/tf` and `/tf_static`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.errors import SpikelaneError

_Matrix = NDArray[np.float64]


class Transform(NamedTuple):
    """Where a frame is in another."""

    translation: tuple[float, float, float]  # x, y, z [m]
    quaternion: tuple[float, float, float, float]  # x, y, z, w

    def matrix(self) -> _Matrix:
        """Return it as a homogeneous matrix, (4, 4).

        Raises:
            SpikelaneError: The quaternion has no length, or a number is not finite.
        """
        from scipy.spatial.transform import Rotation

        numbers = np.array((*self.translation, *self.quaternion))
        if not np.isfinite(numbers).all() or not np.any(self.quaternion):
            raise SpikelaneError(
                f'transform: expected finite numbers and a quaternion, got {numbers.tolist()}'
            )
        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_quat(self.quaternion).as_matrix()
        matrix[:3, 3] = self.translation
        return matrix


class TransformTree:
    """The latest transform of each frame in its parent."""

    def __init__(self) -> None:
        """Begin without frames."""
        self._parents: dict[str, tuple[str, _Matrix]] = {}

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of all frames that have a parent."""
        return tuple(sorted(self._parents))

    def add(self, parent: str, child: str, transform: Transform) -> None:
        """Take over where a frame is.

        Raises:
            SpikelaneError: As `Transform.matrix`.
        """
        self._parents[child] = (parent, transform.matrix())

    def find(self, base: str, frame: str) -> _Matrix | None:
        """Return where a frame is in another, (4, 4); None where they are not connected."""
        from_root = dict(self._to_root(base))
        for ancestor, to_frame in self._to_root(frame):
            if ancestor in from_root:
                found: _Matrix = np.linalg.inv(from_root[ancestor]) @ to_frame
                return found
        return None

    def _to_root(self, frame: str) -> Iterator[tuple[str, _Matrix]]:
        """Yield a frame and its ancestors, each with where the frame is in it."""
        matrix, seen = np.eye(4), set[str]()
        while frame not in seen:
            yield frame, matrix
            seen.add(frame)
            if frame not in self._parents:
                return
            frame, to_parent = self._parents[frame]
            matrix = to_parent @ matrix
