"""A lap over ROS: starts the nodes in a domain of their own, drives in lockstep, ends them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import json
from pathlib import Path
import time
from typing import Any

import numpy as np
from spikelane_msgs.srv import Reset

from spikelane.bag.changes import read_changes
from spikelane.bag.source import BagSource
from spikelane.nodes.graph import COMPOSED, driving_processes, running_nodes, Supervisor
from spikelane.processes import ProcessError
from spikelane.recording.bag import write_recording
from spikelane.runs.folder import RunFolder
from spikelane.runs.lap.config import LapConfig
from spikelane.runs.lap.run import DrivenLap
from spikelane.runs.lap.trajectory import Trajectory
from spikelane.runs.lap.trajectory_bag import message_counts, read_trajectory
from spikelane.runs.output import OnProgress
from spikelane_controllers.registry import card, controller_class
from spikelane_sim import topic_names
from spikelane_sim.contract import sensors_of
from spikelane_sim.nodes.meeting import meeting_parameters
from spikelane_sim.parameter_changes import changeable_specs

LAST_ANSWER_S = 5.0
_NEXT_EPISODE = -1  # in place of a seed: go on with the one before

#: What is recorded of every lap.
TOPICS = (
    topic_names.TF_STATIC,
    topic_names.ROBOT_DESCRIPTION,
    topic_names.CLOCK,
    topic_names.TF,
    topic_names.ODOMETRY,
    topic_names.LANE_STATE,
    topic_names.LANE_DISTANCE,
    topic_names.DIAGNOSTICS,
    topic_names.CONTROLLER_STATE,
    topic_names.EVENTS,
    topic_names.WHEELS,
    topic_names.SIMULATOR_CHANGES,
)

#: Topics with a message for each answer. Nobody waits for the answer to the last observation.
_OF_ANSWERS = (topic_names.CONTROLLER_STATE, topic_names.WHEELS, topic_names.RECORDED)
#: Topics with any number of messages.
_ANY_NUMBER = (
    topic_names.DIAGNOSTICS,
    topic_names.WEIGHTS,  # none of networks that are too large to be looked at
    topic_names.SIMULATOR_CHANGES,
    topic_names.CONTROLLER_CHANGES,
)
_LATCHED = (topic_names.TF_STATIC, topic_names.ROBOT_DESCRIPTION)


def recorded_topics(controller: str, record: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the topics of a lap that are recorded, with all that its controller is given.

    The names are relative, except for those that are the same in every namespace.
    """
    topics: tuple[str, ...] = TOPICS
    if card(controller).training:  # only a controller that learns publishes its weights
        topics += (topic_names.WEIGHTS,)
    if 'encoders' in sensors_of(controller_class(controller)):
        topics += (topic_names.JOINT_STATES,)
    if any(changeable_specs(controller_class(controller).parameters_class)):
        topics += (topic_names.CONTROLLER_CHANGES,)
    if record:
        topics += (topic_names.RECORDED,)
    return topics


def drive_lap_over_ros(
    config: LapConfig,
    folder: RunFolder,
    show: OnProgress,
    viewer: Mapping[str, Any] | None = None,
    record: Sequence[str] = (),
) -> DrivenLap:
    """Drive and record a lap with simulator, controller and recorder as processes.

    With the transport 'composed' simulator and controller are nodes of one process.

    The arguments are those of `spikelane.runs.lap.run.drive`.

    Raises:
        SpikelaneError: A node ended or fell silent, or the recording is not complete.
    """
    wall_time_s = _drive(config, folder, show, is_recorded=True, viewer=viewer, record=record)
    trajectory = read_trajectory(folder.bag)
    _check_complete(trajectory)
    counts = message_counts(folder.bag)
    _check_counts(counts, recorded_topics(config.controller, record), len(trajectory))
    if record:
        write_recording(config, folder.bag, trajectory.stamp_ns.tolist(), record, folder.recording)
    return DrivenLap(trajectory, wall_time_s, folder.bag, notes=_changes_in(folder.bag, counts))


def drive_unrecorded(config: LapConfig, folder: RunFolder) -> float:
    """Drive without a recorder, once to warm up and once more for the time.

    In its first steps a process loads compiled kernels and meets its peer's buffers, which takes
    as long as hundreds of steps.

    Returns:
        The wall time of the second episode, from its first observation to its last [s].

    Raises:
        SpikelaneError: A node ended or fell silent.
    """
    return _drive(config, folder, lambda step, progress_m: None, is_recorded=False)


def _drive(
    config: LapConfig,
    folder: RunFolder,
    show: OnProgress,
    *,
    is_recorded: bool,
    viewer: Mapping[str, Any] | None = None,
    record: Sequence[str] = (),
) -> float:
    parameters = node_parameters(config, folder, is_recorded=is_recorded, record=record)
    composed = config.controller if config.transport == COMPOSED else ''
    with running_nodes(parameters, folder, viewer, composed) as (processes, supervisor):
        wall_time_s = _drive_episode(config, config.seed, supervisor, show)
        if not is_recorded:
            wall_time_s = _drive_episode(config, _NEXT_EPISODE, supervisor, show)
        processes.check()  # what has ended before it was told to may have cut something short
        # The recorder goes last: what the others sent is on its way to it.
        processes.stop(*driving_processes(config.controller, config.transport))
        processes.stop(*processes.statuses())
        processes.check_endings()
    return wall_time_s


def node_parameters(
    config: LapConfig, folder: RunFolder, *, is_recorded: bool, record: Sequence[str] = ()
) -> dict[str, dict[str, Any]]:
    """Return the parameters of a lap's nodes.

    Simulator and controller wait for each other and the recorder before they publish.
    """
    simulator, controller = meeting_parameters(config.controller, is_recorded=is_recorded)
    seed = {'seed': config.seed}
    recorded = {'record_quantities': list(record)} if record else {}
    own, filters = config.controller_parameters.to_dict(), config.filter.chosen()
    recorder = {
        'output': str(folder.bag.absolute()),
        'topics': list(recorded_topics(config.controller, record)),
        'custom_data': [
            f'seed={config.seed}',
            f'controller={config.controller}',
            f'scenario={config.scenario}',
            f'period_ms={config.simulator.period_ms}',
            f'parameters={json.dumps(own)}',
            *([f'filter={json.dumps(filters)}'] if filters else []),
        ],
    }
    return {
        **({'recorder': recorder} if is_recorded else {}),
        'simulator': config.simulator.to_dict() | seed | simulator | {'autostart': False},
        config.controller: own | config.filter.node_parameters() | seed | controller | recorded,
    }


def _drive_episode(
    config: LapConfig, seed: int, supervisor: Supervisor, show: OnProgress
) -> float:
    """Drive one episode; return its wall time [s]."""
    supervisor.wait_for('the simulator', supervisor.reset.service_is_ready)
    # The simulator's diagnostics must reach us before the one that says it is over.
    supervisor.wait_for('diagnostics of the simulator', lambda: bool(supervisor.values))
    answer = supervisor.reset.call_async(Reset.Request(lane=config.lane, seed=seed))
    supervisor.wait_for(f'{config.controller} and the recorder to join', answer.done)
    if not answer.result().success:
        supervisor.check_simulator()
        raise ProcessError(f'reset: {answer.result().message}')
    start_s = time.monotonic()
    episode = str(answer.result().episode)

    def is_over(quiet_s: float) -> bool:
        """Return whether the episode is over and its last observation answered, as it should."""
        values = supervisor.values
        is_answered = values.get('answered') == 'True' or quiet_s > LAST_ANSWER_S
        is_terminated = values.get('terminated') == 'True' and values.get('episode') == episode
        return is_answered and is_terminated

    def show_progress() -> None:
        values = supervisor.values
        show(int(values.get('step', -1)), float(values.get('progress_m', 0.0)))

    supervisor.watch(is_over, show_progress)
    return time.monotonic() - start_s


def _check_counts(counts: Mapping[str, int], topics: Sequence[str], observations: int) -> None:
    """Check that a recording has each topic of each step, also those that nothing is made of.

    The recorder itself compares what it has written with what was published; this is what there
    is in the end.
    """
    lacks = []
    for topic in topics:
        expected = 1 if topic in _LATCHED else observations - (topic in _OF_ANSWERS)
        count = counts.get(f'/{topic.lstrip("/")}', 0)
        if topic not in _ANY_NUMBER and count < expected:
            lacks.append(f'{expected - count} of {expected} messages of /{topic.lstrip("/")}')
    if lacks:
        raise ProcessError(f'the recording lacks {", ".join(lacks)}')


def _changes_in(bag: Path, counts: Mapping[str, int]) -> tuple[str, ...]:
    """Return what was changed of the nodes' parameters while they drove, a sentence each."""
    topics = (topic_names.SIMULATOR_CHANGES, topic_names.CONTROLLER_CHANGES)
    if not any(counts.get(f'/{topic}') for topic in topics):
        return ()
    return tuple(read_changes(BagSource(bag)).notes())


def _check_complete(trajectory: Trajectory) -> None:
    observations = int(trajectory.step[-1]) + 1
    # Nobody waits for the answer to the last one.
    unanswered = int(np.isnan(trajectory.left_rad_s[:-1]).sum())
    if len(trajectory) < observations or unanswered:
        raise ProcessError(
            f'the recording has {len(trajectory)} of {observations} observations and lacks '
            f'{unanswered} answers: the machine is too busy'
        )
    if not trajectory.reason:
        raise ProcessError(
            f'the recording ends after {observations} observations, before the lap did: the '
            'machine is too busy'
        )
