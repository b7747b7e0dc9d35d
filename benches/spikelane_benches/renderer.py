"""Our renderer against pybullet's TinyRenderer: the same scene, the same images, the time.

pybullet gets the course's markings as strips of triangles, made here from the road's centre line
and not from what our renderer draws. It samples a pixel at its lower left corner where OpenGL and
we sample the centre; the projection is shifted by half a pixel to make up for that.
"""

from __future__ import annotations

from collections.abc import Callable
import math
import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.camera import Camera, CameraParameters
from spikelane_sim.course import Course, load_course
from spikelane_sim.course_file import Marking
from spikelane_sim.curve import length_of, poses_along
from spikelane_sim.ground import painted_stretches
from spikelane_sim.robots.bullet import pybullet

#: Length of a straight piece of a strip; off the arc by 0.2 mm at most on the paper's course [m].
STRIP_STEP_M = 0.05

#: Height of base_link over the floor [m]; how far poses are off their lane [m], off its heading
#: [rad] and tilted [rad].
BODY_HEIGHT_M = 0.13879
MOST_DISTANCE_M = 0.2
MOST_HEADING_RAD = 0.4
MOST_TILT_RAD = math.radians(3.0)


class Mesh(NamedTuple):
    """Triangles."""

    vertices: NDArray[np.float64]  # (n, 3) [m]
    indices: NDArray[np.int64]  # (3 m,), counter-clockwise seen from above


class TinyRenderer:
    """The markings of a course in a physics server of their own."""

    def __init__(self, course: Course, camera: Camera) -> None:
        """Build the scene; close it when done."""
        self._camera = camera
        self._client = pybullet.connect(pybullet.DIRECT)
        for marking in course.markings:
            for begin, end in painted_stretches(marking, length_of(course.centre_line)):
                self._add(make_strip(course, marking, begin, end))

    def render(self, pose: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which pixels show a marking, (H, W)."""
        p = self._camera.parameters
        image = pybullet.getCameraImage(
            p.width,
            p.height,
            *self._matrices(pose),
            renderer=pybullet.ER_TINY_RENDERER,
            shadow=0,
            physicsClientId=self._client,
        )
        return np.reshape(image[4], (p.height, p.width)) >= 0

    def close(self) -> None:
        """Disconnect."""
        pybullet.disconnect(self._client)

    def _add(self, mesh: Mesh) -> None:
        shape = pybullet.createVisualShape(
            pybullet.GEOM_MESH,
            vertices=mesh.vertices.tolist(),
            indices=mesh.indices.tolist(),
            normals=[[0.0, 0.0, 1.0]] * len(mesh.vertices),
            physicsClientId=self._client,
        )
        pybullet.createMultiBody(0, -1, shape, physicsClientId=self._client)

    def _matrices(self, pose: NDArray[np.float64]) -> tuple[list[float], list[float]]:
        """Return the view and the projection matrix of OpenGL, by columns."""
        place, orientation = self._camera.optical_frame
        eye, turn = pybullet.multiplyTransforms(pose[:3], pose[3:], place, orientation)
        axes = np.reshape(pybullet.getMatrixFromQuaternion(turn), (3, 3))
        view = pybullet.computeViewMatrix(eye, (eye + axes[:, 2]).tolist(), (-axes[:, 1]).tolist())
        p = self._camera.parameters
        fov_deg = 2.0 * math.degrees(math.atan(p.height / 2 / self._camera.intrinsics.fy))
        aspect = p.width / p.height
        projection = list(pybullet.computeProjectionMatrixFOV(fov_deg, aspect, p.near_m, p.far_m))
        projection[8] += 1.0 / p.width
        projection[9] += 1.0 / p.height
        return list(view), projection


def make_strip(course: Course, marking: Marking, begin: float, end: float) -> Mesh:
    """Make the triangles of a marking between two arc lengths of the road's centre line."""
    n = math.ceil((end - begin) / STRIP_STEP_M)
    pose = poses_along(course.centre_line, np.linspace(begin, end, n + 1))
    right = np.stack([np.sin(pose[:, 2]), -np.cos(pose[:, 2])], axis=-1)
    edges = [marking.offset_m + side * marking.width_m / 2 for side in (-1.0, 1.0)]
    points = np.stack([pose[:, :2] + edge * right for edge in edges], axis=1).reshape(-1, 2)
    vertices = np.column_stack([points, np.zeros(len(points))])
    # Left and right vertex of each cross-section follow one another.
    quad = np.array([0, 1, 3, 0, 3, 2])
    return Mesh(vertices, (2 * np.arange(n)[:, np.newaxis] + quad).ravel())


def random_poses(course: Course, n_poses: int, seed: int) -> NDArray[np.float64]:
    """Return poses on the lanes in turn, off their centres and a little tilted, (n, 7)."""
    rng = np.random.default_rng(seed)
    lanes = list(course.lanes.values())
    poses = np.empty((n_poses, 7))
    for i in range(n_poses):
        lane = lanes[i % len(lanes)]
        x, y, heading = poses_along(lane.centre, rng.uniform(0.0, lane.length_m))
        right = rng.uniform(-MOST_DISTANCE_M, MOST_DISTANCE_M)
        poses[i, :3] = x + right * np.sin(heading), y - right * np.cos(heading), BODY_HEIGHT_M
        roll, pitch = rng.uniform(-MOST_TILT_RAD, MOST_TILT_RAD, 2)
        heading += rng.uniform(-MOST_HEADING_RAD, MOST_HEADING_RAD)
        poses[i, 3:] = pybullet.getQuaternionFromEuler((roll, pitch, heading))
    return poses


def compare_renderers(
    n_poses: int, course_name: str = 'scenario_1', seed: int = 0
) -> dict[str, Any]:
    """Render the same scene with both renderers from random poses.

    Returns:
        `iou`, intersection over union of the marking pixels of all images, `iou_per_pose`, and
        the medians of the times per image [us] with their ratio.
    """
    course = load_course(course_name)
    camera = Camera(CameraParameters(), course)
    tiny = TinyRenderer(course, camera)
    try:
        poses = random_poses(course, n_poses, seed)
        camera.render(poses[0])  # compiles
        runs = [(_timed(camera.render, pose), _timed(tiny.render, pose)) for pose in poses]
    finally:
        tiny.close()
    ours = np.stack([image > course.ground.floor_intensity for (image, _), _ in runs])
    theirs = np.stack([image for _, (image, _) in runs])
    both, either = (ours & theirs).sum(axis=(1, 2)), (ours | theirs).sum(axis=(1, 2))
    ours_us, theirs_us = (float(np.median([run[k][1] for run in runs])) for k in (0, 1))
    return {
        'course': course_name,
        'poses': n_poses,
        'seed': seed,
        'iou': float(both.sum() / either.sum()),
        'iou_per_pose': (both / np.maximum(either, 1) + (either == 0)).tolist(),
        'renderer_us': ours_us,
        'tiny_renderer_us': theirs_us,
        'ratio': theirs_us / ours_us,
    }


def _timed(
    render: Callable[[NDArray[np.float64]], NDArray[Any]], pose: NDArray[np.float64]
) -> tuple[NDArray[Any], float]:
    """Return the image and the time [us] of the second of two calls, when caches are warm."""
    render(pose)
    start = time.perf_counter()
    image = render(pose)
    return image, (time.perf_counter() - start) * 1e6
