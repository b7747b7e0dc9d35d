"""The event camera's optics: a pinhole camera fixed to the robot that sees the ground.

Image coordinates are continuous: pixel (column, row) covers [column, column + 1) times
[row, row + 1) and its centre is at + 0.5; row 0 is the top; the principal point of an image of
width W is at W / 2. So does OpenGL count; who counts from the centre of the first pixel, as OpenCV
does, subtracts 0.5.

An image is drawn exactly: without anti-aliasing every pixel has the intensity of the ground where
the ray through its centre meets it. With it, a pixel is the average along four lines across it,
on the shipped courses within 0.001, on average, of what 16 x 16 rays per pixel give.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple, NoReturn, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spikelane_sim import raster
from spikelane_sim.course import Course
from spikelane_sim.errors import ParameterError, SpikelaneError
from spikelane_sim.ground import Ground
from spikelane_sim.parameters import parameter, Parameters

#: Scanlines per row of pixels with anti-aliasing.
ANTIALIAS_ROWS = 4

_PAPER = "Paper sections 2 and 3.2; the authors' scene"
_SCENE = "The authors' scene"


@dataclasses.dataclass(frozen=True, kw_only=True)
class CameraParameters(Parameters):
    """The camera and where it sits on the robot."""

    width: int = parameter(
        128, 'Number of pixel columns of the sensor.', unit='px', low=1, high=2048, source=_PAPER
    )
    height: int = parameter(
        128, 'Number of pixel rows of the sensor.', unit='px', low=1, high=2048, source=_PAPER
    )
    fov_deg: float = parameter(
        100.0,
        'Full horizontal angle of view; pixels are square.',
        unit='deg',
        low=1.0,
        high=170.0,
        source=_SCENE,
    )
    pitch_deg: float = parameter(
        30.0,
        'Angle of the optical axis below the horizontal.',
        unit='deg',
        low=-90.0,
        high=90.0,
        source=_SCENE,
    )
    yaw_deg: float = parameter(
        0.0,
        'Angle by which the camera is turned to the left of straight ahead.',
        unit='deg',
        low=-180.0,
        high=180.0,
    )
    x_m: float = parameter(
        0.2329,
        'Position of the camera in base_link, forwards.',
        unit='m',
        low=-10.0,
        high=10.0,
        source=_SCENE,
    )
    y_m: float = parameter(
        0.008,
        'Position of the camera in base_link, to the left.',
        unit='m',
        low=-10.0,
        high=10.0,
        source=_SCENE,
    )
    z_m: float = parameter(
        0.1170,
        'Position of the camera in base_link, upwards.',
        unit='m',
        low=-10.0,
        high=10.0,
        source=_SCENE,
    )
    near_m: float = parameter(
        0.05,
        'Smallest depth along the optical axis at which the ground is seen.',
        unit='m',
        low=0.001,
        high=100.0,
        source=_SCENE,
    )
    far_m: float = parameter(
        2.0,
        'Largest depth along the optical axis at which the ground is seen.',
        unit='m',
        low=0.001,
        high=1000.0,
        source=_SCENE,
    )
    background_intensity: float = parameter(
        0.0, 'Linear intensity above the horizon and beyond far_m.', low=0.0, high=1.0
    )
    contrast: float = parameter(
        1.0,
        'Factor of the Michelson contrast between floor and markings, of which the mean intensity '
        'is kept: less in a veil of light, or where the paint has faded.',
        low=0.0,
        high=1.0,
    )
    antialias: bool = parameter(
        False,
        'Average the ground over the area of each pixel instead of sampling it at the centre.',
        source=_SCENE,
    )

    def _check_relations(self) -> None:
        if not self.near_m < self.far_m:
            raise ParameterError(
                f'near_m: expected less than far_m ({self.far_m:g} m), got {self.near_m:g}'
            )


class Intrinsics(NamedTuple):
    """Projection of the camera: u = fx x / z + cx, v = fy y / z + cy."""

    fx: float  # [px]
    fy: float  # [px]
    cx: float  # [px], half the width, see the module's docstring
    cy: float  # [px]


def intrinsics(parameters: CameraParameters) -> Intrinsics:
    """Return the projection of a camera."""
    width, height = parameters.width, parameters.height
    focal = width / 2 / math.tan(math.radians(parameters.fov_deg) / 2)
    return Intrinsics(focal, focal, width / 2, height / 2)


class Mounting(NamedTuple):
    """A frame's place in base_link."""

    translation: tuple[float, float, float]  # x, y, z [m]
    orientation: tuple[float, float, float, float]  # quaternion x, y, z, w


class CameraModel(Protocol):
    """What a simulator needs of a camera."""

    @property
    def parameters(self) -> CameraParameters:
        """Size of the image, lens and place on the robot."""

    @property
    def intrinsics(self) -> Intrinsics:
        """Focal lengths and principal point, for camera_info."""

    @property
    def optical_frame(self) -> Mounting:
        """Place of event_camera_optical_frame: z forward, x right, y down in the image."""

    def render_many(self, poses: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return what is seen from n poses of the body.

        Args:
            poses: Poses x, y, z [m] and quaternion x, y, z, w, (n, 7).

        Returns:
            Linear intensities from 0 to 1, (n, height, width), row 0 at the top.
        """


class Camera:
    """Renders what the camera sees of a course.

    Attributes:
        parameters: Size of the image, lens and place on the robot.
        lens: The same as numbers, with the columns of `raster`, (14,).
        ground: What is seen of the course.
    """

    def __init__(self, parameters: CameraParameters, course: Course) -> None:
        """Point the camera at the ground of a course."""
        self._n_rows = ANTIALIAS_ROWS if parameters.antialias else 1
        self.look(parameters, course)

    def look(self, parameters: CameraParameters, course: Course) -> None:
        """Go on from another place, or at another course; the image's size stays."""
        self.parameters = parameters
        self.ground = seen_ground(course, parameters)
        self.lens = make_lens(parameters)

    @property
    def intrinsics(self) -> Intrinsics:
        """Focal lengths and principal point, for camera_info."""
        return intrinsics(self.parameters)

    @property
    def optical_frame(self) -> Mounting:
        """Place of event_camera_optical_frame: z forward, x right, y down in the image."""
        p = self.parameters
        # Turning from forward-left-up to right-down-forward, then by the pitch about left, then by
        # the yaw about up.
        half, yaw = math.radians(p.pitch_deg) / 2, math.radians(p.yaw_deg) / 2
        sine, cosine = math.sin(half) / 2, math.cos(half) / 2
        x, y, z, w = -cosine - sine, cosine + sine, sine - cosine, cosine - sine
        s, c = math.sin(yaw), math.cos(yaw)
        orientation = (c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z)
        return Mounting((p.x_m, p.y_m, p.z_m), orientation)

    def render(
        self, pose: ArrayLike, out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """Return the image of the ground.

        Args:
            pose: Pose of the body: x, y, z [m] and quaternion x, y, z, w, (7,).
            out: Image to draw into, (H, W); a new one where there is none.

        Returns:
            Linear intensities from 0 to 1, (H, W), row 0 at the top.

        Raises:
            SpikelaneError: The pose is not finite, or an array has another shape.
        """
        p = self.parameters
        pose = np.ascontiguousarray(pose, np.float64)
        if out is None:
            out = np.empty((p.height, p.width), np.float32)
        if pose.shape != (7,) or out.shape != (p.height, p.width):
            self._refuse(pose, out)
        if not raster.render(*self.ground, self.lens, pose, self._n_rows, out):
            self._refuse(pose, out)
        return out

    def render_many(
        self, poses: ArrayLike, out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """Return the images from n poses (n, 7), as `render` would, (n, H, W)."""
        p = self.parameters
        poses = np.ascontiguousarray(poses, np.float64)
        shape = (len(poses), p.height, p.width)
        if out is None:
            out = np.empty(shape, np.float32)
        if poses.shape != (len(poses), 7) or out.shape != shape:
            self._refuse(poses, out)
        if not raster.render_many(*self.ground, self.lens, poses, self._n_rows, out):
            self._refuse(poses, out)
        return out

    def _refuse(self, pose: NDArray[np.float64], out: NDArray[np.float32]) -> NoReturn:
        p = self.parameters
        raise SpikelaneError(
            f'camera: expected finite poses of 7 numbers and images of {p.height} x {p.width}, '
            f'got poses {pose.tolist()!r:.200} and images of shape {out.shape}'
        )


def make_lens(parameters: CameraParameters) -> NDArray[np.float64]:
    """Return a camera as numbers, with the columns of `raster`, (14,)."""
    pitch, yaw = math.radians(parameters.pitch_deg), math.radians(parameters.yaw_deg)
    lens = np.empty(raster.N_LENS)
    lens[raster.FX : raster.CY + 1] = intrinsics(parameters)
    lens[raster.NEAR], lens[raster.FAR] = parameters.near_m, parameters.far_m
    lens[raster.PLACE : raster.PLACE + 3] = parameters.x_m, parameters.y_m, parameters.z_m
    lens[raster.PITCH_SIN], lens[raster.PITCH_COS] = math.sin(pitch), math.cos(pitch)
    lens[raster.YAW_SIN], lens[raster.YAW_COS] = math.sin(yaw), math.cos(yaw)
    lens[raster.BACKGROUND] = parameters.background_intensity
    return lens


def seen_ground(course: Course, parameters: CameraParameters) -> Ground:
    """Return what a camera sees of a course: its ground, at the contrast of the camera.

    With the Michelson contrast c = (marking - floor) / (marking + floor), mean m and a factor k,
    marking and floor become m (1 + k c) and m (1 - k c).
    """
    ground = course.ground
    if parameters.contrast == 1.0:
        return ground
    mean = (ground.marking_intensity + ground.floor_intensity) / 2
    half = parameters.contrast * (ground.marking_intensity - ground.floor_intensity) / 2
    return ground._replace(floor_intensity=mean - half, marking_intensity=mean + half)
