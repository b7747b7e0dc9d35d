"""Loads what a controller needs before its first observation comes."""

from __future__ import annotations

import contextlib
import dataclasses

from event_camera_msgs.msg import EventPacket
from spikelane_msgs.msg import LaneState

from spikelane_sim import messages
from spikelane_sim.contract import (
    Controller,
    controller_rng,
    Observation,
    sensors_of,
    WheelEncoders,
)
from spikelane_sim.errors import ParameterError
from spikelane_sim.events import no_events
from spikelane_sim.filters import FilterParameters, FilterStage
from spikelane_sim.nodes import conversions
from spikelane_sim.period import PERIOD_NS
from spikelane_sim.sensor import Sensor


def warm_up(
    controller: Controller, image_size: tuple[int, int], filters: FilterParameters
) -> None:
    """Take a step that nobody sees.

    Compiled kernels are loaded by the first call, or compiled: the robot must not wait for that.
    """
    width, height = image_size
    packet = EventPacket(width=width, height=height)
    conversions.fill_event_packet(packet, no_events(), PERIOD_NS, 0, 'evt3')
    lane = messages.lane_state_from_message(LaneState())
    still = WheelEncoders((0.0, 0.0), (0.0, 0.0))
    encoders = still if 'encoders' in sensors_of(controller) else None
    controller.reset(controller_rng(0, 0))
    for name in filters.names:
        with contextlib.suppress(ParameterError):  # a mask is for the size of a camera's image
            FilterStage(dataclasses.replace(filters, chain=name), width, height)
    sensor = Sensor(width=width, height=height, has_lane=True)
    for step in sensor.add(messages.received_packet(packet)):
        controller.step(Observation(step.stamp_ns, step.events, lane, encoders))
