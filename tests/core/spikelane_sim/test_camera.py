"""The camera's optics and images: by hand, by rays of the tests' own, and by pybullet."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray
import pybullet
import pytest

from spikelane_benches.renderer import compare_renderers, random_poses
from spikelane_sim.camera import Camera, CameraParameters
from spikelane_sim.course import Course, load_course
from spikelane_sim.errors import ParameterError, SpikelaneError

# At the start of the outer lane, at rest.
AT_START = np.array([3.0, 0.25, 0.13879, 0.0, 0.0, 0.0, 1.0])


def cast_rays(camera: Camera, course: Course, pose: NDArray[np.float64], n: int) -> NDArray:
    """Return what n x n rays per pixel see on average, from rotation matrices alone."""
    p = camera.parameters
    body = np.reshape(pybullet.getMatrixFromQuaternion(pose[3:]), (3, 3))
    pitch = math.radians(p.pitch_deg)
    forward = body @ [math.cos(pitch), 0.0, -math.sin(pitch)]
    right, down = body @ [0.0, -1.0, 0.0], body @ [-math.sin(pitch), 0.0, -math.cos(pitch)]
    eye = pose[:3] + body @ [p.x_m, p.y_m, p.z_m]
    focal = p.width / 2 / math.tan(math.radians(p.fov_deg / 2))
    u = ((np.arange(p.width * n) + 0.5) / n - p.width / 2)[np.newaxis, :, np.newaxis] / focal
    v = ((np.arange(p.height * n) + 0.5) / n - p.height / 2)[:, np.newaxis, np.newaxis] / focal
    ray = forward + u * right + v * down
    with np.errstate(divide='ignore', invalid='ignore'):
        depth = -eye[2] / ray[..., 2]
    seen = (depth >= p.near_m) & (depth <= p.far_m)
    ground = eye[:2] + np.where(seen, depth, 0.0)[..., np.newaxis] * ray[..., :2]
    image = np.full(seen.shape, p.background_intensity)
    image[seen] = course.intensity(ground[seen, 0], ground[seen, 1])
    return image.reshape(p.height, n, p.width, n).mean(axis=(1, 3))


def test_intrinsics_are_those_of_a_field_of_100_degrees() -> None:
    """64 px over tan 50 degrees; the principal point between the four middle pixels."""
    camera = Camera(CameraParameters(), load_course('scenario_1'))
    assert camera.intrinsics == pytest.approx((53.7024, 53.7024, 64.0, 64.0), abs=1e-4)


def test_the_optical_frame_looks_ahead_and_down() -> None:
    """Its z axis is 30 degrees below the robot's x axis, its x axis points to the right."""
    camera = Camera(CameraParameters(), load_course('scenario_1'))
    place, orientation = camera.optical_frame
    axes = np.reshape(pybullet.getMatrixFromQuaternion(orientation), (3, 3))
    assert place == (0.2329, 0.008, 0.1170)
    assert axes[:, 2] == pytest.approx([math.sqrt(0.75), 0.0, -0.5], abs=1e-6)
    assert axes[:, 0] == pytest.approx([0.0, -1.0, 0.0], abs=1e-6)
    assert axes[:, 1] == pytest.approx([-0.5, 0.0, -math.sqrt(0.75)], abs=1e-6)


def test_a_camera_that_is_turned_looks_to_the_left_of_ahead() -> None:
    """By 20 degrees, as the camera of a body that is turned by as much."""
    course = load_course('scenario_1')
    place = {'x_m': 0.0, 'y_m': 0.0}
    turned = Camera(CameraParameters(yaw_deg=20.0, **place), course)
    axes = np.reshape(pybullet.getMatrixFromQuaternion(turned.optical_frame.orientation), (3, 3))
    sine, cosine = math.sin(math.radians(20)), math.cos(math.radians(20))
    expected = [math.sqrt(0.75) * cosine, math.sqrt(0.75) * sine, -0.5]
    assert axes[:, 2] == pytest.approx(expected, abs=1e-6)
    assert axes[:, 0] == pytest.approx([sine, -cosine, 0.0], abs=1e-6)
    half = math.radians(10)
    body = np.array([*AT_START[:3], 0.0, 0.0, math.sin(half), math.cos(half)])
    ahead = Camera(CameraParameters(**place), course)
    assert np.mean(turned.render(AT_START) != ahead.render(body)) < 1e-3
    assert np.mean(turned.render(AT_START) != ahead.render(AT_START)) > 0.01


def test_less_contrast_keeps_the_mean_of_floor_and_markings() -> None:
    """Half of the Michelson contrast of white on black is three quarters on a quarter."""
    course = load_course('scenario_1')
    image = Camera(CameraParameters(contrast=0.5), course).render(AT_START)
    assert set(np.unique(image).tolist()) == {0.0, 0.25, 0.75}  # 0 beyond 2 m
    assert set(np.unique(Camera(CameraParameters(), course).render(AT_START))) == {0.0, 1.0}


def test_the_right_edge_is_seen_where_the_projection_puts_it() -> None:
    """Row 90, by hand.

    Its centre is 26.5 px below the axis or 26.5 / 53.7024 of the depth, the camera is 0.25579 m
    above the floor: the depth there is 0.2758 m. The camera is 0.258 m left of the road's edge,
    whose line is 0.04 m wide: columns from 64 + 53.7024 * 0.238 / 0.2758 = 110.3 to 118.1.
    """
    camera = Camera(CameraParameters(), load_course('scenario_1'))
    image = camera.render(AT_START)
    assert np.flatnonzero(image[90, 64:]).tolist() == list(range(110 - 64, 118 - 64))


def test_nothing_is_seen_above_the_far_plane() -> None:
    """The axis' depth of 2 m is reached 22.4 px above the middle: rows 0 to 40 are background."""
    camera = Camera(CameraParameters(background_intensity=0.5), load_course('scenario_1'))
    image = camera.render(AT_START)
    assert (image[:41] == 0.5).all()
    assert set(np.unique(image[41:])) == {0.0, 1.0}
    assert (image.shape, image.dtype) == ((128, 128), np.float32)


@pytest.mark.parametrize('tilt', [0.0, 0.05, 0.6, 3.0])
@pytest.mark.parametrize('name', ['scenario_1', 'scenario_2', 'scenario_3'])
def test_every_pixel_is_the_ground_at_its_centre(name: str, tilt: float) -> None:
    """The same bits as a ray through each centre, level, tilted a little, and upside down."""
    course = load_course(name)
    camera = Camera(CameraParameters(background_intensity=0.25), course)
    rng = np.random.default_rng(3)
    for pose in random_poses(course, 6, seed=1):
        angles = np.array(pybullet.getEulerFromQuaternion(pose[3:]))
        angles[:2] = rng.uniform(-tilt, tilt, 2)
        pose[3:] = pybullet.getQuaternionFromEuler(angles)
        image = camera.render(pose)
        assert np.count_nonzero(image != cast_rays(camera, course, pose, 1)) <= 1


@pytest.mark.parametrize(
    'parameters',
    [
        CameraParameters(width=40, height=60, fov_deg=60.0),
        CameraParameters(pitch_deg=90.0, x_m=0.0, y_m=0.0, z_m=1.0),
        CameraParameters(pitch_deg=-5.0),
        CameraParameters(near_m=0.4, far_m=1.0),
        CameraParameters(fov_deg=150.0, far_m=30.0),
    ],
    ids=['oblong', 'from above', 'looking up', 'clipped', 'wide'],
)
def test_other_cameras_see_the_ground_at_their_pixels_centres_too(
    parameters: CameraParameters,
) -> None:
    """Oblong, from above, mostly sky, nearly clipped away, and wide with a long range."""
    course = load_course('scenario_1')
    camera = Camera(parameters, course)
    for pose in random_poses(course, 4, seed=2):
        image = camera.render(pose)
        assert np.count_nonzero(image != cast_rays(camera, course, pose, 1)) <= 1


def test_antialiased_pixels_are_averages_over_their_areas() -> None:
    """Close to 16 x 16 rays per pixel, on average and everywhere, and closer than without."""
    course = load_course('scenario_3')
    plain = Camera(CameraParameters(), course)
    smooth = Camera(CameraParameters(antialias=True), course)
    for pose in random_poses(course, 4, seed=4):
        expected = cast_rays(smooth, course, pose, 16)
        error = np.abs(smooth.render(pose) - expected)
        assert error.mean() < 0.001
        assert error.max() < 0.3
        assert error.mean() < 0.1 * np.abs(plain.render(pose) - expected).mean()


def test_antialiasing_blends_floor_and_background_too() -> None:
    """Whatever the three intensities are, pixels are averages and never beyond them."""
    course = load_course('scenario_1')
    ground = course.ground._replace(floor_intensity=0.6, marking_intensity=0.1)
    course = dataclasses.replace(course, ground=ground)
    camera = Camera(CameraParameters(antialias=True, background_intensity=0.9), course)
    for pose in random_poses(course, 3, seed=5):
        image = camera.render(pose)
        assert np.abs(image - cast_rays(camera, course, pose, 16)).mean() < 0.002
        assert image.min() >= np.float32(0.1)
        assert image.max() <= np.float32(0.9)


def test_many_poses_give_the_images_of_each() -> None:
    """Into new images and into given ones."""
    course = load_course('scenario_1')
    camera = Camera(CameraParameters(), course)
    poses = random_poses(course, 5, seed=6)
    images = camera.render_many(poses)
    out = np.ones((128, 128), np.float32)
    for pose, image in zip(poses, images, strict=True):
        assert camera.render(pose, out) is out
        assert np.array_equal(image, out)


@pytest.mark.parametrize('height', [0.0, -1.0])
def test_a_camera_below_the_floor_sees_nothing(height: float) -> None:
    """At the floor's height, and below."""
    camera = Camera(CameraParameters(z_m=0.0), load_course('scenario_1'))
    assert not camera.render([3.0, 0.25, height, 0.0, 0.0, 0.0, 1.0]).any()


@pytest.mark.parametrize(
    'pose', [[0.0] * 6, [math.nan] * 7, [0.0] * 7, [1, 2, math.inf, 0, 0, 0, 1]]
)
def test_poses_that_are_none_are_refused(pose: list[float]) -> None:
    """Too few numbers, not finite, a quaternion of zeros."""
    camera = Camera(CameraParameters(), load_course('scenario_1'))
    with pytest.raises(SpikelaneError, match='camera: expected finite poses of 7 numbers'):
        camera.render(pose)
    with pytest.raises(SpikelaneError, match='camera: expected finite poses of 7 numbers'):
        camera.render_many([pose])


def test_clipping_planes_must_be_in_order() -> None:
    """The near one is nearer."""
    with pytest.raises(ParameterError, match='near_m: expected less than far_m'):
        CameraParameters(near_m=2.0, far_m=1.0)


@pytest.mark.parametrize('name', ['scenario_1', 'scenario_2', 'scenario_3'])
def test_pybullet_renders_the_same_markings(name: str) -> None:
    """Marking pixels agree to an IoU of 0.97 over 60 poses, tilted by up to 3 degrees."""
    result = compare_renderers(60, name)
    assert result['poses'] == len(result['iou_per_pose']) == 60
    assert result['iou'] >= 0.97
    assert min(result['iou_per_pose']) >= 0.9
