"""One lap: what determines it, driving it in-process, and what it leaves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
import dataclasses
from pathlib import Path
import time
from typing import Any, NamedTuple

from spikelane.figures import draw_lap
from spikelane.loop import drive_episode
from spikelane.metrics import lap_metrics
from spikelane.run_folder import lap_name, RunFolder
from spikelane.trajectory import Trajectory, TrajectoryRecorder, write_csv
from spikelane_controllers.registry import controller_class, make_controller
from spikelane_sim.contract import Observation, STEP_S, WheelVelocities
from spikelane_sim.course import load_course, scenario_course
from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import Parameters
from spikelane_sim.simulator import Simulator, SimulatorParameters

TRANSPORTS = ('ros', 'inprocess')

#: Shows how a lap goes on: steps driven, metres along the lane.
Show = Callable[[int, float], None]


@dataclasses.dataclass(frozen=True, kw_only=True)
class LapConfig:
    """Everything that determines a lap.

    Attributes:
        scenario: Of the paper, '1' to '3', or the name or path of another course.
        controller: Name in the controllers' registry.
        lane: Name of the lane.
        seed: Of the simulator's and the controller's randomness.
        transport: One of TRANSPORTS.
        simulator: Its parameters; `simulator_parameters` makes them.
        controller_parameters: Of the controller's own class.
    """

    scenario: str
    controller: str
    lane: str
    seed: int
    transport: str
    simulator: SimulatorParameters
    controller_parameters: Parameters

    def to_dict(self) -> dict[str, Any]:
        """Return all of it under names, ready for YAML."""
        return {
            'scenario': self.scenario,
            'controller': self.controller,
            'lane': self.lane,
            'seed': self.seed,
            'transport': self.transport,
            'simulator': self.simulator.to_dict(),
            self.controller: self.controller_parameters.to_dict(),
        }


class DrivenLap(NamedTuple):
    """What came of driving."""

    trajectory: Trajectory
    wall_time_s: float  # from the first observation to the last
    bag: Path | None


def make_config(
    scenario: str,
    controller: str,
    lane: str | None,
    seed: int,
    transport: str,
    parameters: Mapping[str, Any],
) -> LapConfig:
    """Make the configuration of a lap.

    Args:
        scenario: As in LapConfig.
        controller: As in LapConfig.
        lane: None for the course's first.
        seed: As in LapConfig.
        transport: As in LapConfig.
        parameters: Others than the defaults, as `simulator.camera.fov_deg` and
            `braitenberg.poisson.max_rate_hz`.

    Raises:
        SpikelaneError: Anything is unknown or not allowed.
    """
    cls = controller_class(controller).parameters_class
    groups: dict[str, dict[str, Any]] = {
        'simulator': {'course': scenario_course(scenario)},
        controller: {},
    }
    for name, value in parameters.items():
        group, _, rest = name.partition('.')
        if group not in groups:
            expected = ' or '.join(f'{group}.<name>' for group in groups)
            raise ParameterError(f'unknown parameter {name!r}; expected {expected}')
        if name == 'simulator.course' and value != scenario_course(scenario):
            raise ParameterError(f'simulator.course: expected that of --scenario, got {value!r}')
        groups[group][rest] = value
    if not 0 <= seed < 2**63:
        raise ParameterError(f'seed: expected a whole number from 0 to 2^63 - 1, got {seed}')
    simulator = SimulatorParameters.from_mapping(groups['simulator'], 'simulator')
    lanes = load_course(simulator.course)
    return LapConfig(
        scenario=scenario,
        controller=controller,
        lane=lanes.lane(lane).name if lane else next(iter(lanes.lanes)),
        seed=seed,
        transport=transport,
        simulator=simulator,
        controller_parameters=cls.from_mapping(groups[controller], controller),
    )


def drive_lap(config: LapConfig, show: Show) -> DrivenLap:
    """Drive a lap in this process.

    Args:
        config: What to drive.
        show: Called after every step.
    """
    recorder = TrajectoryRecorder()
    controller = make_controller(config.controller, config.controller_parameters.to_dict())
    with Simulator(config.simulator) as simulator:

        def on_step(observation: Observation, wheels: WheelVelocities) -> None:
            recorder.append(observation, simulator.robot_state, wheels)
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
    return DrivenLap(recorder.trajectory(), wall_time_s, None)


def make_folder(config: LapConfig, out: Path | None) -> RunFolder:
    """Make the folder a lap leaves, with its configuration in it.

    Args:
        config: What is going to be driven.
        out: The folder, new or empty; None for the usual one, numbered where it exists.

    Raises:
        SpikelaneError: The folder is in use or cannot be made.
    """
    usual = Path('runs') / lap_name(
        Path(config.scenario).stem, config.controller, config.lane, config.seed
    )
    folder = RunFolder.create(out or usual, numbered=out is None)
    folder.write_config(config.to_dict())
    return folder


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
        **measured,
        'steps_per_s': measured['steps'] / driven.wall_time_s,
        'folder': str(folder.path),
        'bag': None if driven.bag is None else str(driven.bag),
        'figure': str(figure),
    }
    folder.write_metrics(result)
    return result
