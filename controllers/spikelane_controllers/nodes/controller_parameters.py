"""Parameters of every controller node."""

from __future__ import annotations

from dataclasses import dataclass

from rclpy.qos import ReliabilityPolicy

from spikelane_sim.binning import SensorParameters
from spikelane_sim.drive_limiter import BaseParameters
from spikelane_sim.filters import FilterParameters
from spikelane_sim.nodes.meeting import MeetingParameters
from spikelane_sim.parameters import nested, parameter

RELIABILITIES = {
    'auto': ReliabilityPolicy.RELIABLE,  # until a publisher is met that is not
    'reliable': ReliabilityPolicy.RELIABLE,
    'best_effort': ReliabilityPolicy.BEST_EFFORT,
}


@dataclass(frozen=True, kw_only=True)
class ControllerNodeParameters(MeetingParameters):
    """How a controller takes part in a ROS graph."""

    seed: int = parameter(0, "Seed of the controller's randomness.", low=0, high=2**63 - 1)
    use_lane_state: bool = parameter(
        True, 'Wait for a message on lane/state with each event packet; false for a real camera.'
    )
    reliability: str = parameter(
        'auto',
        'Reliability of the subscription to event_camera/events. auto: reliable, so that nothing '
        'is lost, but best_effort where a publisher is, as the drivers of cameras are.',
        choices=tuple(RELIABILITIES),
    )
    record_quantities: tuple[str, ...] = parameter(
        (),
        'Quantities of the controller, as spikes and weights, that are published on '
        'controller/recorded in each step; all: everything that it offers; none: no such topic.',
    )
    command: str = parameter(
        'wheels',
        "What drives the robot. wheels: wheel_velocities alone. twist, twist_stamped: the robot's "
        'base takes cmd_vel as Twist or TwistStamped, which is published in addition to them.',
        choices=('wheels', 'twist', 'twist_stamped'),
    )
    max_events_per_s: float = parameter(
        0.0,
        'The base is stopped while the camera sends more events than this, as flickering light '
        'or a fault makes it do; 0: never.',
        unit='1/s',
        low=0.0,
        high=1e12,
    )
    base: BaseParameters = nested(BaseParameters)
    sensor: SensorParameters = nested(SensorParameters)
    filter: FilterParameters = nested(FilterParameters)
