"""Lens distortion: where on the image plane a lens puts a ray, by the models of ROS.

The names are those of `sensor_msgs/CameraInfo`, the equations those of OpenCV's documentation:

- `plumb_bob`: k1, k2, p1, p2, k3 ("Camera Calibration and 3D Reconstruction");
- `rational_polynomial`: k1, k2, p1, p2, k3, k4, k5, k6 (the same page);
- `equidistant`: k1, k2, k3, k4 ("Fisheye camera model").

A polynomial is fitted to the rays inside the image. Far outside it may turn back, so that a ray
from beyond the edge would seem to be in the image. Such rays are not seen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

#: Number of coefficients of each model.
MODELS = {'plumb_bob': 5, 'rational_polynomial': 8, 'equidistant': 4}

_SAMPLES = 4096  # angles at which it is checked whether a polynomial turns back

_Array = NDArray[np.float64]


def distort(
    model: str, coefficients: Sequence[float], x: _Array, y: _Array
) -> tuple[_Array, _Array]:
    """Return where a lens puts rays.

    Args:
        model: One of `MODELS`.
        coefficients: Those of the model.
        x: Tangent of each ray's angle to the right of the optical axis, (N,).
        y: Tangent of each ray's angle below the optical axis, (N,).

    Returns:
        Coordinates on the image plane at depth 1, to the right and down, (N,) each; NaN for a ray
        that is not seen.
    """
    if model == 'equidistant':
        factor = _stretch(np.hypot(x, y), lambda r: _fisheye(r, coefficients))
        return factor * x, factor * y
    k1, k2, p1, p2, *others = coefficients
    radial = (k1, k2, *others)
    square = x**2 + y**2
    factor = _stretch(np.hypot(x, y), lambda r: _rational(r, radial))
    return (
        factor * x + 2 * p1 * x * y + p2 * (square + 2 * x**2),
        factor * y + p1 * (square + 2 * y**2) + 2 * p2 * x * y,
    )


def _rational(radius: _Array, coefficients: Sequence[float]) -> _Array:
    """Return the radii on the image plane of `plumb_bob` and `rational_polynomial`."""
    k1, k2, k3, k4, k5, k6 = (*coefficients, 0.0, 0.0, 0.0)[:6]
    s = radius**2
    return radius * (1 + s * (k1 + s * (k2 + s * k3))) / (1 + s * (k4 + s * (k5 + s * k6)))


def _fisheye(radius: _Array, coefficients: Sequence[float]) -> _Array:
    """Return the radii on the image plane of `equidistant`."""
    k1, k2, k3, k4 = coefficients
    angle = np.arctan(radius)
    s = angle**2
    return angle * (1 + s * (k1 + s * (k2 + s * (k3 + s * k4))))


def _stretch(radius: _Array, distorted: Callable[[_Array], _Array]) -> _Array:
    """Return how much farther from the centre rays are put; NaN beyond where that turns back."""
    largest = float(radius.max(initial=0.0))
    # Evenly in the angle: a single ray along the image plane may have any radius.
    samples: _Array = np.tan(np.linspace(0.0, np.arctan(largest), _SAMPLES, dtype=np.float64))
    turns = np.flatnonzero(np.diff(distorted(samples)) <= 0)
    limit = samples[turns[0]] if len(turns) and largest > 0 else np.inf
    factor = np.divide(distorted(radius), radius, out=np.ones_like(radius), where=radius > 0)
    return np.where(radius <= limit, factor, np.nan)
