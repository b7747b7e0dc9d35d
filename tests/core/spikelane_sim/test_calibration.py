"""Calibrations: where pixels see the floor, and files."""

import math
from pathlib import Path

import numpy as np
import pytest

from spikelane_sim.calibration import (
    Calibration,
    CalibrationError,
    make_calibration,
    place_and_angles,
    read_calibration,
    write_calibration,
)
from spikelane_sim.simulated_calibration import simulated_calibration
from spikelane_sim.simulator_parameters import SimulatorParameters

#: 3 x 3 pixels; one pixel off the centre is 45 degrees off the axis.
SMALL = Calibration(
    3, 3, (1.0, 1.0), (1.0, 1.0), 'plumb_bob', (0.0,) * 5, (0.2, 0.1, 0.5), (0.0, 45.0, 0.0)
)


def test_pixels_see_the_floor_where_their_rays_meet_it() -> None:
    """From 0.5 m, 45 degrees down: 0.5 m ahead at the centre, straight down in the last row."""
    points = SMALL.floor_points().reshape(3, 3, 2)
    np.testing.assert_allclose(points[1, 1], (0.7, 0.1))
    np.testing.assert_allclose(points[2, 1], (0.2, 0.1), atol=1e-12)
    # One pixel to the right is to the right by the depth along the axis, 0.5 m * sqrt(2).
    np.testing.assert_allclose(points[1, 2], (0.7, 0.1 - 0.5 * math.sqrt(2)))
    assert np.isnan(points[0]).all()  # along the horizon


def test_a_camera_turned_to_the_left_sees_to_the_left() -> None:
    """A yaw of 90 degrees turns ahead into left; a roll of 90 degrees turns right into down."""
    turned = SMALL._replace(angles_deg=(0.0, 45.0, 90.0))
    np.testing.assert_allclose(turned.floor_points()[4], (0.2, 0.6))
    rolled = SMALL._replace(angles_deg=(90.0, 0.0, 0.0))
    np.testing.assert_allclose(rolled.rotation, [[0, 0, -1], [0, 1, 0], [1, 0, 0]], atol=1e-12)


def test_the_pixel_of_a_point_is_the_one_that_sees_it() -> None:
    """There and back; nothing outside the image and beyond the depths."""
    points = np.array([[0.7, 0.1], [0.2, 0.1], [0.7, 0.1 - 0.5 * math.sqrt(2)], [0.7, 5.0]])
    assert SMALL.pixels_of(points).tolist() == [4, 7, 5, -1]
    # The depths of these points: 0.5 sqrt(2), 0.5 / sqrt(2), 0.5 sqrt(2) m.
    assert SMALL._replace(far_m=0.6).pixels_of(points).tolist() == [-1, 7, -1, -1]
    assert SMALL._replace(near_m=0.6).pixels_of(points).tolist() == [4, -1, 5, -1]


def test_the_paper_s_camera_sees_the_floor_that_the_simulator_draws() -> None:
    """A point straight ahead: 0.2558 m high, the centre's ray 30 degrees down."""
    camera = simulated_calibration(SimulatorParameters())
    assert camera.place_m == pytest.approx((0.1884, 0.008, 0.25579))
    assert camera.focal_px[0] == pytest.approx(64 / math.tan(math.radians(50)))
    assert camera.centre_px == (63.5, 63.5)
    point = (0.1884 + 0.25579 / math.tan(math.radians(30)), 0.008)
    assert camera.pixels_of(np.array([point]) + 1e-6).tolist() in (
        [63 * 128 + 63],
        [63 * 128 + 64],
    )


def test_a_file_that_was_written_is_read_again(tmp_path: Path) -> None:
    """With all numbers, also those of depth."""
    file = tmp_path / 'camera.yaml'
    for camera in (SMALL, simulated_calibration(SimulatorParameters())):
        write_calibration(file, camera)
        assert read_calibration(file) == camera


def test_place_and_angles_are_those_of_a_transform() -> None:
    """An optical frame that looks down by 30 degrees, and to the left by 10."""
    pitch, yaw = math.radians(30), math.radians(10)
    forwards = (math.cos(pitch) * math.cos(yaw), math.cos(pitch) * math.sin(yaw), -math.sin(pitch))
    right = (math.sin(yaw), -math.cos(yaw), 0.0)
    transform = np.eye(4)
    transform[:3, 0], transform[:3, 2] = right, forwards
    transform[:3, 1] = np.cross(forwards, right)
    transform[:3, 3] = (0.1, -0.2, 0.3)
    place, angles = place_and_angles(transform)
    assert place == pytest.approx((0.1, -0.2, 0.3))
    assert angles == pytest.approx((0.0, 30.0, 10.0), abs=1e-9)


def test_numbers_that_are_not_finite_are_refused() -> None:
    """As a driver may publish them."""
    matrix = [math.nan, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0]
    with pytest.raises(CalibrationError, match='expected finite numbers'):
        make_calibration((3, 3), matrix, 'plumb_bob', [0.0] * 5, (0, 0, 1), (0, 0, 0))


@pytest.mark.parametrize(
    ('old', 'new', 'reason'),
    [
        ('image_width: 3', 'image_width: 0', 'image_width: expected a whole number from 1'),
        ('plumb_bob', 'fov', 'distortion_model: expected one of plumb_bob'),
        ('z_m: 0.5', 'z_m: 0.0', 'mounting.z_m: expected a height above the floor, got 0'),
        ('pitch_deg: 45.0', 'tilt_deg: 45.0', "unknown key 'tilt_deg' of mounting"),
        ('image_height: 3\n', '', "expected the key 'image_height'"),
    ],
)
def test_a_file_that_is_wrong_is_refused(tmp_path: Path, old: str, new: str, reason: str) -> None:
    """By its path, and what was expected."""
    file = tmp_path / 'camera.yaml'
    write_calibration(file, SMALL)
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    with pytest.raises(CalibrationError, match=r'camera\.yaml') as error:
        read_calibration(file)
    assert reason in str(error.value)
