"""One lap: driving it in this process or over ROS, and what it leaves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
import time
from typing import Any, NamedTuple

from spikelane.loop import drive_episode, OnStep
from spikelane.recording.record import facts_of, recorded, Recording
from spikelane.runs.configuration import configured_controller
from spikelane.runs.folder import RunFolder
from spikelane.runs.lap.config import LapConfig
from spikelane.runs.lap.figure import draw_lap
from spikelane.runs.lap.metrics import lap_metrics
from spikelane.runs.lap.trajectory import Trajectory, TrajectoryRecorder, write_csv
from spikelane.runs.output import OnProgress
from spikelane.runs.transport import over_ros
from spikelane_controllers.operations import Operations, sum_operations
from spikelane_controllers.registry import title as controller_title
from spikelane_controllers.shown import shown_by
from spikelane_sim.contract import (
    Controller,
    Observation,
    sensors_of,
    WheelVelocities,
)
from spikelane_sim.course import load_course
from spikelane_sim.filters import FilterParameters
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters


class DrivenLap(NamedTuple):
    """What came of driving."""

    trajectory: Trajectory
    wall_time_s: float  # from the first observation to the last
    bag: Path | None
    operations: Operations | None = None  # where they could be counted: in this process
    notes: tuple[str, ...] = ()  # what the configuration does not tell, a sentence each


def drive(
    config: LapConfig,
    folder: RunFolder,
    show: OnProgress,
    viewer: Mapping[str, Any] | None = None,
    record: Sequence[str] = (),
) -> DrivenLap:
    """Drive a lap in this process or over ROS, as its configuration says.

    Args:
        config: What to drive.
        folder: Where the recording goes, and over ROS bag, logs and node parameters.
        show: Called after every step, over ROS about once a second.
        viewer: Parameters of a viewer that is to watch, over ROS; None: there is none.
        record: Quantities that the controller is to record; none for no recording.

    Raises:
        SpikelaneError: The lap cannot be driven, or its recording is not complete.
    """
    if config.transport == 'inprocess':
        asked = Recording(folder.recording, tuple(record)) if record else None
        return drive_lap(config, show, asked)
    driven: DrivenLap = over_ros('lap.nodes.driving', 'drive_lap_over_ros')(
        config, folder, show, viewer, record
    )
    return driven


def drive_lap(
    config: LapConfig, show: OnProgress, recording: Recording | None = None
) -> DrivenLap:
    """Drive a lap in this process.

    Args:
        config: What to drive.
        show: Called after every step.
        recording: What the controller is to record; None for nothing.

    Raises:
        SpikelaneError: The controller does not offer that, or the file cannot be written.
    """
    controller = configured_controller(config)
    with recorded(controller, recording, facts_of(config)) as record_step:

        def on_step(observation: Observation, wheels: WheelVelocities) -> None:
            record_step(observation)
            if observation.lane is not None:
                show(observation.lane.step, observation.lane.progress_m)

        return drive_with(
            controller, config.simulator, config.filter, config.lane, config.seed, on_step
        )


def drive_with(
    controller: Controller,
    parameters: SimulatorParameters,
    filters: FilterParameters,
    lane: str,
    seed: int,
    on_step: OnStep,
) -> DrivenLap:
    """Drive a lap with any controller in this process.

    Args:
        controller: What drives.
        parameters: Parameters of the simulator.
        filters: What events go through before the controller is given them.
        lane: Name of the lane.
        seed: Seed of the randomness of the simulator and the controller.
        on_step: Called after every step.
    """
    recorder = TrajectoryRecorder()
    operations: list[Operations] = []
    with Simulator(parameters, sensors=sensors_of(controller)) as simulator:

        def record(observation: Observation, wheels: WheelVelocities) -> None:
            recorder.append(observation, simulator.robot_state, wheels)
            if (done := shown_by(controller).operations) is not None:
                operations.append(done)
            on_step(observation, wheels)

        start_s = time.perf_counter()
        drive_episode(
            simulator,
            controller,
            record,
            lane=lane,
            seed=seed,
            controller_seed=seed,
            filters=filters,
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
    measured = lap_metrics(trajectory, config.simulator.period_s)
    title = (
        f'{controller_title(config.controller)}, scenario {config.scenario}, {config.lane} lane'
    )
    figure, *_ = draw_lap(
        trajectory, load_course(config.simulator.course), folder.figures / 'lap', title
    )
    result = {
        **config.facts(),
        'lane': config.lane,
        **measured,
        'operations': None if driven.operations is None else driven.operations._asdict(),
        'steps_per_s': measured['steps'] / driven.wall_time_s,
        'folder': str(folder.path),
        'bag': None if driven.bag is None else str(driven.bag),
        'figure': str(figure),
    }
    if driven.notes:
        result['notes'] = list(driven.notes)
    if folder.recording.exists():
        # Whoever records nothing need not wait for HDF5.
        from spikelane.recording.figure import draw_recording

        result['recording'] = str(folder.recording)
        draw_recording(folder.recording, folder.figures / 'recording.png', title)
    folder.write_metrics(result)
    return result
