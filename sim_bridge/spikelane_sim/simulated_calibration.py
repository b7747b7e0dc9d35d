"""The calibration of a simulated camera."""

from __future__ import annotations

from spikelane_sim.calibration import Calibration
from spikelane_sim.camera import intrinsics
from spikelane_sim.simulator_parameters import SimulatorParameters


def simulated_calibration(parameters: SimulatorParameters) -> Calibration:
    """Return the calibration of a simulator's camera on its robot, at rest."""
    camera, robot = parameters.camera, parameters.robot
    fx, fy, cx, cy = intrinsics(camera)
    return Calibration(
        camera.width,
        camera.height,
        (fx, fy),
        (cx - 0.5, cy - 0.5),  # counted from the centre of the first pixel
        'plumb_bob',
        (0.0,) * 5,
        (camera.x_m - robot.axle_x_m, camera.y_m, camera.z_m + robot.height_m),
        (0.0, camera.pitch_deg, camera.yaw_deg),
        camera.near_m,
        camera.far_m,
    )
