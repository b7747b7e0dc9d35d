"""One lap: what determines it, driving it in-process, and what it leaves."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
import dataclasses
import math
from pathlib import Path
import time
from typing import Any, NamedTuple

from spikelane.configuration import (
    Configuration,
    configure,
    configured_controller,
)
from spikelane.figures import draw_lap
from spikelane.loop import drive_episode
from spikelane.metrics import lap_metrics
from spikelane.run_folder import RunFolder
from spikelane.trajectory import Trajectory, TrajectoryRecorder, write_csv
from spikelane.transport import over_ros
from spikelane_controllers.operations import Operations, sum_operations
from spikelane_controllers.registry import controller_class
from spikelane_controllers.shown import shown_by
from spikelane_controllers.weights import shipped_weights
from spikelane_sim.contract import Observation, sensors_of, STEP_S, WheelVelocities
from spikelane_sim.course import course_label, load_course, scenario_course
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

#: Ends a drive that makes no progress: less than 0.1 m farther within 30 s.
NO_PROGRESS_STEPS = 600

#: The time limit of a lap is what this speed needs, a seventh of the usual one [m/s].
SLOWEST_M_S = 0.02

#: Shows how a lap goes on: steps driven, metres along the lane.
OnLapProgress = Callable[[int, float], None]


@dataclasses.dataclass(frozen=True, kw_only=True)
class LapConfig(Configuration):
    """Everything that determines a lap.

    Attributes:
        lane: Name of the lane.
    """

    lane: str

    @property
    def usual_name(self) -> str:
        """As in `run_folder.Run`."""
        scenario = course_label(self.scenario)
        return f'lap-{scenario}-{self.controller}-{self.lane}-seed{self.seed}'


class DrivenLap(NamedTuple):
    """What came of driving."""

    trajectory: Trajectory
    wall_time_s: float  # from the first observation to the last
    bag: Path | None
    operations: Operations | None = None  # where they could be counted: in this process


def make_config(
    scenario: str,
    controller: str,
    lane: str | None,
    seed: int,
    transport: str,
    parameters: Mapping[str, Any],
) -> LapConfig:
    """Make the configuration of a lap: see `configure`; no lane is the course's first.

    A controller that learns has the weights shipped for the scenario unless others are given.
    Unless other limits are given, the drive ends where the robot makes no progress, and after the
    time that the course's longest lane takes at a slow speed (`limit_drive`).

    Raises:
        SpikelaneError: Anything is unknown or not allowed.
    """
    given = {**default_weights(scenario, controller), **parameters}
    parts = configure(scenario, controller, seed, transport, given)
    course = load_course(parts['simulator'].course)
    lane = course.lane(lane).name if lane else next(iter(course.lanes))
    length_m = max(each.length_m for each in course.lanes.values())
    parts['simulator'] = limit_drive(parts['simulator'], parameters, length_m)
    return LapConfig(given=parameters, lane=lane, **parts)


def limit_drive(
    simulator: SimulatorParameters, given: Collection[str], length_m: float
) -> SimulatorParameters:
    """Return a simulator's parameters with limits that end every drive of some laps.

    Args:
        simulator: The parameters.
        given: Names of the parameters that were given: their limits are kept.
        length_m: Length of one lap.
    """
    episode = simulator.episode
    steps = math.ceil(episode.max_laps * length_m / (SLOWEST_M_S * STEP_S))
    limits = {'max_steps': min(steps, 2**31 - 1), 'no_progress_steps': NO_PROGRESS_STEPS}
    missing = {
        name: value for name, value in limits.items() if f'simulator.episode.{name}' not in given
    }
    return dataclasses.replace(simulator, episode=dataclasses.replace(episode, **missing))


def default_weights(scenario: str, controller: str) -> dict[str, Any]:
    """Return the parameter that gives a controller the weights shipped for a scenario, if any.

    Raises:
        SpikelaneError: There is no such scenario.
    """
    name = scenario_course(scenario)
    return {f'{controller}.checkpoint': name} if name in shipped_weights(controller) else {}


def drive(config: LapConfig, folder: RunFolder, show: OnLapProgress) -> DrivenLap:
    """Drive a lap in this process or over ROS, as its configuration says.

    Args:
        config: What to drive.
        folder: Where bag, logs and node parameters go, over ROS.
        show: Called after every step, over ROS about once a second.

    Raises:
        SpikelaneError: The lap cannot be driven, or its recording is not complete.
    """
    if config.transport == 'inprocess':
        return drive_lap(config, show)
    driven: DrivenLap = over_ros('lap', 'drive_lap_over_ros')(config, folder, show)
    return driven


def drive_lap(config: LapConfig, show: OnLapProgress) -> DrivenLap:
    """Drive a lap in this process.

    Args:
        config: What to drive.
        show: Called after every step.
    """
    recorder = TrajectoryRecorder()
    operations: list[Operations] = []
    controller = configured_controller(config)
    sensors = sensors_of(controller_class(config.controller))
    with Simulator(config.simulator, sensors=sensors) as simulator:

        def on_step(observation: Observation, wheels: WheelVelocities) -> None:
            recorder.append(observation, simulator.robot_state, wheels)
            if (done := shown_by(controller).operations) is not None:
                operations.append(done)
            if observation.lane is not None:
                show(observation.lane.step, observation.lane.progress_m)

        start_s = time.perf_counter()
        drive_episode(
            simulator,
            controller,
            on_step,
            lane=config.lane,
            seed=config.seed,
            controller_seed=config.seed,
        )
        wall_time_s = time.perf_counter() - start_s
    total = sum_operations(operations) if operations else None
    return DrivenLap(recorder.trajectory(), wall_time_s, None, total)


def report_lap(config: LapConfig, driven: DrivenLap, folder: RunFolder) -> dict[str, Any]:
    """Write a lap's trajectory, metrics and figure.

    Returns:
        The metrics and where everything is, ready for JSON.
    """
    trajectory = driven.trajectory
    write_csv(trajectory, folder.trajectory)
    measured = lap_metrics(trajectory, STEP_S)
    title = f'{config.controller}, scenario {config.scenario}, {config.lane} lane'
    figure, *_ = draw_lap(
        trajectory, load_course(config.simulator.course), folder.figures / 'lap', title
    )
    result = {
        'scenario': config.scenario,
        'controller': config.controller,
        'lane': config.lane,
        'seed': config.seed,
        'transport': config.transport,
        'robot': config.simulator.robot.model,
        'engine': config.simulator.robot.engine,
        **measured,
        'operations': None if driven.operations is None else driven.operations._asdict(),
        'steps_per_s': measured['steps'] / driven.wall_time_s,
        'folder': str(folder.path),
        'bag': None if driven.bag is None else str(driven.bag),
        'figure': str(figure),
    }
    folder.write_metrics(result)
    return result
