"""Node `camera_calibration`: the simulator's own camera, as ROS describes it."""

from pathlib import Path
from typing import Any

import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo

from spikelane_sim.calibration import read_calibration
from spikelane_sim.simulated_calibration import simulated_calibration
from spikelane_sim.simulator_parameters import SimulatorParameters

pytestmark = pytest.mark.ros

CAMERA = {
    'robot.engine': 'kinematic',
    'camera.width': 346,
    'camera.height': 260,
    'camera.fov_deg': 60.0,
    'camera.pitch_deg': 45.0,
}


def test_the_file_is_that_of_the_simulated_camera(graph: Any, tmp_path: Path) -> None:
    """Lens from camera_info, place from /tf_static; the node ends by itself with 0."""
    file = tmp_path / 'camera.yaml'
    names = ('-r', '__ns:=/calibrated')
    graph.start('simulator', CAMERA, *names)
    node = graph.start(
        'camera_calibration',
        {'file': str(file), 'axle_x_m': 0.0445, 'height_m': 0.13879},
        *names,
    )
    assert node.wait() == 0, node.log
    found = read_calibration(file)
    wanted = simulated_calibration(SimulatorParameters.from_mapping(CAMERA))
    assert found[:2] == (346, 260)
    assert found.focal_px == pytest.approx(wanted.focal_px)
    assert found.centre_px == pytest.approx((172.5, 129.5))
    assert found.place_m == pytest.approx(wanted.place_m)
    assert found.angles_deg == pytest.approx((0.0, 45.0, 0.0), abs=1e-9)
    assert not found.is_distorted


@pytest.mark.parametrize('offered', [ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT])
def test_a_camera_info_without_a_calibration_is_refused(
    graph: Any, tmp_path: Path, offered: ReliabilityPolicy
) -> None:
    """A driver that is not calibrated publishes zeros; the node waits for a better message."""
    file = tmp_path / 'camera.yaml'
    graph.start('simulator', CAMERA, '-r', '__ns:=/placed')
    info = CameraInfo(width=3, height=3, distortion_model='plumb_bob', d=[0.0] * 5)
    info.header.frame_id = 'event_camera_optical_frame'
    lens = graph.node.create_publisher(
        CameraInfo, '/lens', QoSProfile(depth=10, reliability=offered)
    )
    renamed = ('-r', 'event_camera/camera_info:=/lens')
    node = graph.start('camera_calibration', {'file': str(file), 'height_m': 0.13879}, *renamed)

    def is_refused() -> bool:
        lens.publish(info)
        return 'camera_matrix: expected [fx, 0, cx, 0, fy, cy, 0, 0, 1]' in node.log

    graph.until(is_refused, 'the refusal')
    assert node.status is None
    assert not file.exists()
    info.k = [2.0, 0.0, 1.0, 0.0, 2.0, 1.0, 0.0, 0.0, 1.0]

    def has_ended() -> bool:
        lens.publish(info)
        return node.status is not None

    graph.until(has_ended, 'the end of the node')
    assert node.wait() == 0
    assert read_calibration(file).focal_px == (2.0, 2.0)
    assert 'QoS' not in node.log


def test_a_file_is_required(graph: Any) -> None:
    """Status 2 and one line."""
    node = graph.start('camera_calibration', {})
    assert node.wait() == 2
    assert "file: expected the path of a file to write, got ''" in node.log
