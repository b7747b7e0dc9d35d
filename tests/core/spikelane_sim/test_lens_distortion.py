"""Lens distortion, held to OpenCV."""

import numpy as np
import pytest

from spikelane_sim.lens_distortion import distort

X, Y = np.array([0.1, -0.7, 0.9, 0.0]), np.array([0.2, 0.4, -0.5, 0.0])


@pytest.mark.parametrize(
    ('model', 'coefficients', 'x', 'y'),
    [
        (
            'plumb_bob',
            (-0.32, 0.11, 0.0012, -0.0007, -0.02),
            (0.09842625, -0.58490075, 0.681562112, 0.0),
            (0.1969825, 0.334749, -0.377785840, 0.0),
        ),
        (
            'rational_polynomial',
            (0.41, -0.09, 0.0011, -0.0004, 0.003, 0.72, -0.05, 0.004),
            (0.09851001544876772, -0.5955531941005826, 0.7009146011421403, 0.0),
            (0.19711503089753546, 0.34088253948604724, -0.38846655619007797, 0.0),
        ),
        (
            'equidistant',
            (-0.03, 0.012, -0.006, 0.001),
            (0.09824147845446793, -0.5821682924324406, 0.6883227821725979, 0.0),
            (0.19648295690893586, 0.3326675956756804, -0.38240154565144324, 0.0),
        ),
    ],
)
def test_rays_are_put_where_opencv_puts_them(
    model: str, coefficients: tuple[float, ...], x: tuple[float, ...], y: tuple[float, ...]
) -> None:
    """Values of projectPoints and fisheye.projectPoints of opencv-python 4.10.0."""
    found = distort(model, coefficients, X, Y)
    np.testing.assert_allclose(found, (x, y), rtol=1e-12, atol=1e-15)


def test_a_ray_behind_the_edge_is_not_seen() -> None:
    """With k1 = -0.3, r (1 - 0.3 r^2) grows up to r = 1 / sqrt(0.9) = 1.054, and falls then."""
    # The last ray is all but parallel to the image plane.
    right = np.array([1.05, 1.06, 1.8, 1e6])
    x, y = distort('plumb_bob', (-0.3, 0.0, 0.0, 0.0, 0.0), right, np.zeros(4))
    assert x[0] == pytest.approx(1.05 * (1 - 0.3 * 1.05**2))
    assert np.isnan(x[1:]).all()
    assert y[0] == 0
