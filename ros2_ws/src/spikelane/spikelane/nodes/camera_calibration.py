"""Node `camera_calibration`: writes the calibration of a camera in the graph, and ends.

The lens is taken from `camera_info`, the camera's place on the robot from the transforms.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
import sys

from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo
from tf2_msgs.msg import TFMessage

from spikelane_sim import topic_names
from spikelane_sim.calibration import (
    CalibrationError,
    make_calibration,
    place_and_angles,
    write_calibration,
)
from spikelane_sim.errors import ParameterError, SpikelaneError
from spikelane_sim.nodes.parameter_node import ParameterNode
from spikelane_sim.nodes.ros_parameters import declare_parameters
from spikelane_sim.nodes.running import run_node
from spikelane_sim.nodes.waiting import publishers_of, WaitingWarnings
from spikelane_sim.parameters import parameter, Parameters
from spikelane_sim.transform_tree import Transform, TransformTree

#: A best-effort subscription receives what drivers publish, best-effort or reliably.
_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
#: It can lose the first message, and a simulator that waits for a controller sends no other one.
#: A reliable subscription receives that one.
_RELIABLE = QoSProfile(depth=10)
_STATIC = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@dataclass(frozen=True, kw_only=True)
class CameraCalibrationParameters(Parameters):
    """Where the calibration goes, and what the transforms do not say."""

    file: str = parameter('', 'File to write, such as davis.yaml; required.')
    base_frame: str = parameter(
        'base_link', "Frame of the robot's body: x is ahead, z upwards (REP 105)."
    )
    camera_frame: str = parameter(
        '', "The camera's optical frame; empty: the frame_id of camera_info."
    )
    axle_x_m: float = parameter(
        0.0,
        'Distance of the middle between the driven wheels ahead of the base frame.',
        unit='m',
        low=-10.0,
        high=10.0,
    )
    height_m: float = parameter(
        0.0, 'Height of the base frame above the floor.', unit='m', low=0.0, high=10.0
    )


class CameraCalibration(ParameterNode):
    """Waits for a camera_info and the transforms, and writes the calibration."""

    def __init__(self) -> None:
        """Declare the parameters and subscribe.

        Raises:
            ParameterError: A parameter is not allowed.
        """
        super().__init__('camera_calibration')
        self.exit_status = 1  # until the file is written
        self.is_done = False
        self._settings = declare_parameters(self, CameraCalibrationParameters)
        if not self._settings.file:
            raise ParameterError("file: expected the path of a file to write, got ''")
        self._info: CameraInfo | None = None
        self._tree = TransformTree()
        for qos in (_QOS, _RELIABLE):
            self.create_subscription(
                CameraInfo,
                topic_names.CAMERA_INFO,
                self._on_info,
                qos,
                # A best-effort driver does not meet the reliable subscription, and need not.
                event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            )
        self.create_subscription(TFMessage, topic_names.TF_STATIC, self._on_transforms, _STATIC)
        self.create_subscription(TFMessage, topic_names.TF, self._on_transforms, _QOS)
        self._waiting = WaitingWarnings(self, lambda: int(self.is_done), self._lacks)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(0.1, self._look, clock=steady)
        self.get_logger().info(f'ready: takes {topic_names.CAMERA_INFO} and the transforms')

    def _on_info(self, message: CameraInfo) -> None:
        self._info = message

    def _on_transforms(self, message: TFMessage) -> None:
        for each in message.transforms:
            place, turn = each.transform.translation, each.transform.rotation
            try:
                self._tree.add(
                    each.header.frame_id,
                    each.child_frame_id,
                    Transform((place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w)),
                )
            except SpikelaneError as error:
                self.get_logger().error(
                    f'{each.child_frame_id} in {each.header.frame_id}: {error}; left out',
                    throttle_duration_sec=1.0,
                )

    def _look(self) -> None:
        """Write the file once all is known."""
        if self.is_done or self._info is None:
            return
        matrix = self._tree.find(self._settings.base_frame, self._camera_frame(self._info))
        if matrix is None:
            return
        matrix[:3, 3] += (-self._settings.axle_x_m, 0.0, self._settings.height_m)
        place, angles = place_and_angles(matrix)
        info, self._info = self._info, None
        size = info.width, info.height
        try:
            calibration = make_calibration(
                size, info.k.tolist(), info.distortion_model, list(info.d), place, angles
            )
        except CalibrationError as error:  # the next message may have what this one lacks
            self.get_logger().error(
                f'{topic_names.CAMERA_INFO}: {error}; refused', throttle_duration_sec=1.0
            )
            return
        write_calibration(Path(self._settings.file), calibration)
        self.get_logger().info(
            f'{self._settings.file}: camera of {size[0]} x {size[1]} px at x, y, z '
            f'{place[0]:.3f}, {place[1]:.3f}, {place[2]:.3f} m, roll, pitch, yaw '
            f'{angles[0]:.1f}, {angles[1]:.1f}, {angles[2]:.1f} deg'
        )
        self.exit_status, self.is_done = 0, True

    def _camera_frame(self, info: CameraInfo) -> str:
        return self._settings.camera_frame or str(info.header.frame_id)

    def _lacks(self) -> str:
        if self._info is None:
            topic = topic_names.CAMERA_INFO
            return f'waiting for {topic}; {publishers_of(self, topic)} publishers are there'
        frames = ', '.join(self._tree.frames) or 'none'
        return (
            f'waiting for a transform from {self._settings.base_frame} to '
            f'{self._camera_frame(self._info)}; frames that were received: {frames}'
        )


def main() -> None:
    """Run the node."""
    sys.exit(run_node(CameraCalibration))


if __name__ == '__main__':
    main()
