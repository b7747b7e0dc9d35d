"""Calibration of a camera on a robot: its lens, and where it is above the floor.

The file is YAML as ROS's `camera_calibration` writes it (`image_width`, `camera_matrix`,
`distortion_model` and so on), with one more block, `mounting`:

    mounting: {x_m: 0.19, y_m: 0.0, z_m: 0.26, roll_deg: 0.0, pitch_deg: 30.0, yaw_deg: 0.0}

- `x_m`, `y_m`: ahead and to the left of the middle between the driven wheels; the robot turns
  about that point.
- `z_m`: above the floor.
- `roll_deg`, `pitch_deg`, `yaw_deg`: as in a URDF (REP 103), of a camera that looks ahead at zero:
  a positive pitch looks down, a positive yaw to the left, and a positive roll turns the camera
  clockwise as seen from behind.

Optional are `near_m` and `far_m`, the depths between which the camera sees the floor, as a
simulated camera has them.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.errors import ParameterError
from spikelane_sim.files import write_yaml
from spikelane_sim.lens_distortion import distort, MODELS
from spikelane_sim.yaml_file import read_yaml, YamlValue

_MOST_PIXELS = 8192  # in a row or a column
_PARTS_OF_ROS = (
    'image_width image_height camera_matrix distortion_model distortion_coefficients mounting'
)
_DEPTHS = ('near_m', 'far_m')
_OPTIONAL = f'camera_name rectification_matrix projection_matrix {" ".join(_DEPTHS)}'
_LENGTHS, _ANGLES = ('x_m', 'y_m', 'z_m'), ('roll_deg', 'pitch_deg', 'yaw_deg')
_MOST_METRES = 100.0
_LEAST_SLOPE = 1e-9  # of a ray that meets the floor; what is less is rounding, along the horizon

#: From a camera's axes (forwards, left, up) to those of its image (right, down, forwards).
_OPTICAL = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])


class CalibrationError(ParameterError):
    """A file of a camera's calibration cannot be used."""


class Calibration(NamedTuple):
    """A camera on a robot; pixel centres are whole numbers, as in ROS and OpenCV."""

    width: int  # columns [px]
    height: int  # rows [px]
    focal_px: tuple[float, float]  # fx, fy
    centre_px: tuple[float, float]  # cx, cy
    model: str  # of the distortion, one of `MODELS`
    distortion: tuple[float, ...]  # its coefficients
    place_m: tuple[float, float, float]  # x, y, z, see the module
    angles_deg: tuple[float, float, float]  # roll, pitch, yaw
    near_m: float = 0.0
    far_m: float = math.inf

    @property
    def is_distorted(self) -> bool:
        """Whether the lens is anything but a pinhole."""
        return self.model == 'equidistant' or any(self.distortion)

    @property
    def rotation(self) -> NDArray[np.float64]:
        """The axes of the image (right, down, forwards) in those of the robot, (3, 3), as rows."""
        from scipy.spatial.transform import Rotation

        turned = Rotation.from_euler('xyz', self.angles_deg, degrees=True).as_matrix()
        rows: NDArray[np.float64] = _OPTICAL @ turned.T
        return rows

    def floor_points(self) -> NDArray[np.float64]:
        """Return where the centres of a pinhole camera's pixels see the floor.

        Returns:
            Points x, y [m] of all pixels, row by row, (height * width, 2); NaN where a pixel sees
            no floor between `near_m` and `far_m`.
        """
        row, column = np.divmod(np.arange(self.width * self.height), self.width)
        right = (column - self.centre_px[0]) / self.focal_px[0]
        down = (row - self.centre_px[1]) / self.focal_px[1]
        rays = np.stack([right, down, np.ones(len(row))], axis=1) @ self.rotation
        depth = np.full(len(rays), np.nan)
        np.divide(-self.place_m[2], rays[:, 2], out=depth, where=rays[:, 2] < -_LEAST_SLOPE)
        with np.errstate(invalid='ignore'):
            is_seen = (depth >= self.near_m) & (depth <= self.far_m)
        depth[~is_seen] = np.nan
        points: NDArray[np.float64] = self.place_m[:2] + depth[:, None] * rays[:, :2]
        return points

    def pixels_of(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return which pixel sees each point of the floor.

        Args:
            points: x, y [m], (N, 2); NaN for none.

        Returns:
            Numbers of pixels, row by row from the top, (N,); -1 where no pixel sees the point.
        """
        from_camera = np.column_stack([points, np.zeros(len(points))]) - self.place_m
        right, down, depth = self.rotation @ from_camera.T
        is_seen = (depth > 0) & (depth >= self.near_m) & (depth <= self.far_m)
        pixels = np.full(len(points), -1, np.int64)
        x, y = distort(
            self.model,
            self.distortion,
            right[is_seen] / depth[is_seen],
            down[is_seen] / depth[is_seen],
        )
        column = np.floor(self.focal_px[0] * x + self.centre_px[0] + 0.5)
        row = np.floor(self.focal_px[1] * y + self.centre_px[1] + 0.5)
        is_inside = (column >= 0) & (column < self.width) & (row >= 0) & (row < self.height)
        numbers = np.full(len(x), -1, np.int64)
        numbers[is_inside] = row[is_inside] * self.width + column[is_inside]
        pixels[is_seen] = numbers
        return pixels


def make_calibration(
    size: tuple[int, int],
    camera_matrix: Sequence[float],
    model: str,
    distortion: Sequence[float],
    place_m: tuple[float, float, float],
    angles_deg: tuple[float, float, float],
    near_m: float = 0.0,
    far_m: float = math.inf,
) -> Calibration:
    """Return a calibration that has been checked.

    Args:
        size: Columns and rows [px].
        camera_matrix: fx, 0, cx, 0, fy, cy, 0, 0, 1 [px], as in `CameraInfo.k`.
        model: Name of the distortion's model.
        distortion: Its coefficients.
        place_m: See `Calibration`, as the others.
        angles_deg: Roll, pitch and yaw.
        near_m: Smallest depth at which the floor is seen.
        far_m: Largest depth.

    Raises:
        CalibrationError: Something is not allowed.
    """
    if not all(1 <= number <= _MOST_PIXELS for number in size):
        raise CalibrationError(
            f'image_width, image_height: expected 1 to {_MOST_PIXELS} px, '
            f'got {size[0]} x {size[1]} px'
        )
    is_pinhole = len(camera_matrix) == 9 and not any(camera_matrix[i] for i in (1, 3, 6, 7))
    if not all(map(math.isfinite, (*camera_matrix, *distortion))):
        raise CalibrationError(
            'camera_matrix, distortion_coefficients: expected finite numbers, '
            f'got {[*camera_matrix, *distortion]!r:.200}'
        )
    if not is_pinhole or min(camera_matrix[0], camera_matrix[4]) <= 0 or camera_matrix[8] != 1:
        raise CalibrationError(
            'camera_matrix: expected [fx, 0, cx, 0, fy, cy, 0, 0, 1] with positive focal lengths, '
            f'got {list(camera_matrix)!r:.200}'
        )
    if model not in MODELS:
        raise CalibrationError(
            f'distortion_model: expected one of {", ".join(MODELS)}, got {model!r:.80}'
        )
    if len(distortion) != MODELS[model]:
        raise CalibrationError(
            f'distortion_coefficients: expected {MODELS[model]} numbers for {model}, '
            f'got {len(distortion)}'
        )
    if not place_m[2] > 0:
        raise CalibrationError(
            f'mounting.z_m: expected a height above the floor, got {place_m[2]:g}'
        )
    if not 0 <= near_m < far_m:
        raise CalibrationError(f'far_m: expected more than near_m ({near_m:g}), got {far_m:g}')
    fx, _, cx, _, fy, cy, *_ = map(float, camera_matrix)
    depths = near_m, far_m
    return Calibration(
        *size, (fx, fy), (cx, cy), model, tuple(distortion), place_m, angles_deg, *depths
    )


def place_and_angles(
    transform: NDArray[np.float64],
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return a camera's place [m], and roll, pitch and yaw [deg].

    Args:
        transform: From the camera's optical frame (right, down, forwards) to that of the module's
            docstring, homogeneous, (4, 4).
    """
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_matrix(transform[:3, :3] @ _OPTICAL).as_euler('xyz', degrees=True)
    x, y, z = map(float, transform[:3, 3])
    roll, pitch, yaw = map(float, turned)
    return (x, y, z), (roll, pitch, yaw)


def read_calibration(path: Path) -> Calibration:
    """Read a camera's calibration.

    Raises:
        CalibrationError: It cannot be read, or something in it is missing or not allowed.
    """
    content = read_yaml(path, 'the calibration of a camera', CalibrationError)
    fields = content.fields(_PARTS_OF_ROS, _OPTIONAL)
    mounting = fields['mounting'].fields(' '.join((*_LENGTHS, *_ANGLES)))
    x, y, z = (mounting[name].number(-_MOST_METRES, _MOST_METRES) for name in _LENGTHS)
    roll, pitch, yaw = (mounting[name].number(-360, 360) for name in _ANGLES)
    depths = {name: fields[name].number(0, 1e6) for name in _DEPTHS if name in fields}
    width, height = (
        fields[name].whole_number(1, _MOST_PIXELS) for name in ('image_width', 'image_height')
    )
    matrix, distortion = (
        _numbers(fields[name]) for name in ('camera_matrix', 'distortion_coefficients')
    )
    model = fields['distortion_model'].text()
    place, angles = (x, y, z), (roll, pitch, yaw)
    try:
        return make_calibration(
            (width, height), matrix, model, distortion, place, angles, **depths
        )
    except CalibrationError as error:
        raise CalibrationError(f'{path}: {error}') from None


def write_calibration(path: Path, calibration: Calibration) -> None:
    """Write a camera's calibration.

    Raises:
        FileError: It cannot be written.
    """
    c = calibration
    (fx, fy), (cx, cy) = c.focal_px, c.centre_px
    depths = {'near_m': c.near_m} if c.near_m else {}
    depths |= {'far_m': c.far_m} if math.isfinite(c.far_m) else {}
    content = {
        'image_width': c.width,
        'image_height': c.height,
        'camera_matrix': _block((fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0), 3),
        'distortion_model': c.model,
        'distortion_coefficients': _block(c.distortion, 1),
        'mounting': {
            **dict(zip(_LENGTHS, map(float, c.place_m), strict=True)),
            **dict(zip(_ANGLES, map(float, c.angles_deg), strict=True)),
        },
        **depths,
    }
    write_yaml(path, content)


def _numbers(value: YamlValue) -> tuple[float, ...]:
    """Return the numbers of a matrix as ROS writes it: rows, cols, data."""
    data = value.fields('data', 'rows cols')['data']
    return tuple(item.number(-1e9, 1e9) for item in data.items())


def _block(numbers: tuple[float, ...], rows: int) -> dict[str, object]:
    return {'rows': rows, 'cols': len(numbers) // rows, 'data': [float(each) for each in numbers]}
