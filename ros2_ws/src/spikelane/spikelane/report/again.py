"""What the camera saw on a lap, which its trajectory does not hold: the lap is driven once more.

The recorded wheel velocities go into the simulator that the lap's configuration describes. It is
deterministic, so that the robot does the same; that it did is checked step by step.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

from spikelane.report.runs import Lap
from spikelane.runs.lap.trajectory import Trajectory
from spikelane_sim.contract import WheelVelocities
from spikelane_sim.course import scenario_course
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.events import Events
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters


class Seen(NamedTuple):
    """A drive with what the camera saw.

    Attributes:
        trajectory: Its first lap, or all of it where there is none; n rows.
        events: Events of each row, n arrays.
        image_size: Width and height of the camera's image [px].
    """

    trajectory: Trajectory
    events: list[Events]
    image_size: tuple[int, int]


def drive_again(lap: Lap, trajectory: Trajectory) -> Seen:
    """Drive the first lap of a drive once more.

    Args:
        lap: Lap of the drive.
        trajectory: What it left.

    Raises:
        SpikelaneError: The simulator is another than then, so that the robot does not do the
            same; the message has the step.
    """
    parameters = SimulatorParameters.from_mapping(lap.config['simulator'], 'simulator')
    course = scenario_course(str(lap.config['scenario']))
    events: list[Events] = []
    first = first_lap(trajectory)
    with Simulator(dataclasses.replace(parameters, course=course)) as simulator:
        observation = simulator.reset(lap.lane, lap.seed)
        commands = zip(first.left_rad_s.tolist(), first.right_rad_s.tolist(), strict=True)
        for row, (left, right) in enumerate(commands):
            state = observation.lane
            assert state is not None  # a simulator always knows it
            there = float(first.distance_m[row]), int(first.events[row])
            if (state.distance_m, len(observation.events)) != there:
                raise SpikelaneError(
                    f'{lap.folder}: expected step {row} to be the same again, with {there[1]} '
                    f'events, got {len(observation.events)}: is it of another version or machine?'
                )
            events.append(observation.events)
            if row < len(first) - 1:
                observation = simulator.step(WheelVelocities(left, right))
    return Seen(first, events, (parameters.camera.width, parameters.camera.height))


def first_lap(trajectory: Trajectory) -> Trajectory:
    """Return a drive up to the end of its first lap, or all of it."""
    rows = min(int((trajectory.laps == 0).sum()) + 1, len(trajectory))
    columns = {name: column[:rows] for name, column in trajectory.columns().items()}
    reason = trajectory.reason if rows == len(trajectory) else ''
    return Trajectory(lane=trajectory.lane, reason=reason, **columns)  # type: ignore[arg-type]
