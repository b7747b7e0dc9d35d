"""Bit planes: the images and events of `Camera` and `CoppeliaPixels`, in bits."""

import numpy as np
import pytest

from spikelane_sim.bit_planes import fire_planes, fires_always, render_planes, unpack, words_of
from spikelane_sim.camera import Camera, CameraParameters
from spikelane_sim.course import Course, load_course
from spikelane_sim.curve import poses_along
from spikelane_sim.events import EVENT_DTYPE
from spikelane_sim.pixels.coppelia import CoppeliaParameters, CoppeliaPixels
from spikelane_sim.raster import render


def random_poses(course: Course, number: int) -> np.ndarray:
    """Return poses on a lane, also tilted, too high and below the floor, (number, 7)."""
    rng, lane = np.random.default_rng(1), next(iter(course.lanes.values()))
    x, y, heading = poses_along(lane.centre, rng.uniform(0, lane.length_m, number)).T
    poses = np.zeros((number, 7))
    poses[:, 0], poses[:, 1] = x, y
    poses[:, 2] = rng.choice([0.139, 1.0, -0.5], number, p=[0.8, 0.1, 0.1])
    poses[:, 5], poses[:, 6] = np.sin(heading / 2), np.cos(heading / 2)
    poses[:, 3:] += rng.normal(0, 0.05, (number, 4))
    return poses


@pytest.mark.parametrize('course', ['scenario_1', 'scenario_3', 'random:7'])
@pytest.mark.parametrize(
    ('width', 'height', 'background'),
    [(128, 128, 0.0), (100, 60, 0.3), (200, 90, 0.3), (346, 300, 0.3)],
)
def test_images_are_those_of_the_camera(
    course: str, width: int, height: int, background: float
) -> None:
    """Pixel by pixel, from any pose."""
    parameters = CameraParameters(width=width, height=height, background_intensity=background)
    camera = Camera(parameters, load_course(course))
    ground = load_course(course).ground
    planes = np.empty((2, height, words_of(width)), np.uint64)
    intensities = (background, ground.floor_intensity, ground.marking_intensity)
    n_markings = 0
    for pose in random_poses(load_course(course), 60):
        has_floor = ground.floor_intensity != background
        assert render_planes(ground.pieces, has_floor, camera.lens, pose, width, planes)
        image = camera.render(pose)
        assert np.array_equal(unpack(planes, width, intensities), image)
        n_markings += int((image == np.float32(ground.marking_intensity)).sum())
    assert n_markings > 3000
    pose[0] = np.nan
    assert not render_planes(ground.pieces, True, camera.lens, pose, width, planes)


def test_a_course_may_have_any_number_of_markings() -> None:
    """They are looked for in parts; here each of 120 is there seven times, out of order."""
    course = load_course('scenario_1')
    camera, pieces = Camera(CameraParameters(), course), course.ground.pieces
    many = np.random.default_rng(3).permutation(np.repeat(pieces, 7, axis=0))
    assert len(many) == 840
    few_planes, many_planes = (np.empty((2, 128, 2), np.uint64) for _ in range(2))
    few_image, many_image = (np.empty((128, 128), np.float32) for _ in range(2))
    for pose in random_poses(course, 20):
        assert render_planes(pieces, True, camera.lens, pose, 128, few_planes)
        assert render_planes(many, True, camera.lens, pose, 128, many_planes)
        assert np.array_equal(many_planes, few_planes)
        assert render(pieces, 0.2, 0.9, camera.lens, pose, 1, few_image)
        assert render(many, 0.2, 0.9, camera.lens, pose, 1, many_image)
        assert np.array_equal(many_image, few_image)


def test_events_are_those_of_the_pixels() -> None:
    """With three intensities of which each change fires."""
    intensities = (0.0, 0.2, 0.9)
    assert fires_always(*intensities, 0.1, 0.001)
    rng, pixels = np.random.default_rng(2), CoppeliaPixels(CoppeliaParameters(), 70, 9)
    pixels.reset(rng)
    events = np.empty(70 * 9, EVENT_DTYPE)
    before = np.zeros((2, 9, 2), np.uint64)
    for step in range(20):
        levels = rng.integers(0, 3, (9, 128)) * (rng.random((9, 128)) < 0.3)
        levels[:, 70:] = 0
        bits = np.stack([levels == 1, levels == 2])
        planes = np.packbits(bits, axis=-1, bitorder='little').view(np.uint64)
        image = unpack(planes, 70, intensities)
        assert np.array_equal(image, np.float32(intensities)[levels[:, :70]])
        expected = pixels.step(image[None], step * 50_000_000, (step + 1) * 50_000_000)
        if step == 0:
            before[:] = planes
            continue
        values = np.float32(intensities).astype(float)
        number = fire_planes(before, planes, values, (step + 1) * 50_000_000, events)
        assert np.array_equal(events[:number], expected)
        assert number > 100


@pytest.mark.parametrize(
    ('intensities', 'fires'),
    [((0.0, 0.0, 1.0), True), ((0.5, 0.52, 1.0), False), ((0.0, 0.00005, 1.0), False)],
)
def test_small_differences_do_not_always_fire(
    intensities: tuple[float, float, float], fires: bool
) -> None:
    """0.52 is 4 % more than 0.5; 0.00005 is 5 % of the intensity that black counts as."""
    assert fires_always(*intensities, 0.1, 0.001) == fires
