"""Training over ROS: simulator and learning controller as processes, in lockstep."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from spikelane.nodes.graph import (
    COMPOSED,
    driving_processes,
    running_nodes,
    START_DEADLINE_S,
)
from spikelane.processes import ProcessError
from spikelane.runs.folder import RunFolder
from spikelane.runs.output import OnProgress
from spikelane.runs.train.config import TrainConfig
from spikelane.runs.train.run import make_training
from spikelane_controllers.learning.training import Training
from spikelane_sim.nodes.meeting import meeting_parameters

_END_S = 10.0  # for a node to end by itself, once it has nothing more to do


def train_over_ros(
    config: TrainConfig,
    folder: RunFolder,
    show: OnProgress,
    *,
    resume: bool,
    viewer: Mapping[str, Any] | None = None,
) -> Training:
    """Train with simulator and controller as processes.

    The arguments are those of `spikelane.runs.train.run.train`.

    Returns:
        The training as its last checkpoint has it.

    Raises:
        SpikelaneError: There is no checkpoint to resume from, a node failed, or the training
            ended before all steps were driven.
    """
    # Whether this can be begun or resumed is found out here, before anything is started.
    begun = make_training(config, folder, resume=resume)
    if begun.is_done:
        return begun
    parameters = node_parameters(config, folder)
    composed = config.controller if config.transport == COMPOSED else ''
    learner = driving_processes(config.controller, config.transport)[-1]
    with running_nodes(parameters, folder, viewer, composed) as (processes, supervisor):

        def show_progress() -> None:
            values = supervisor.values
            show(
                begun.steps_after(int(values.get('steps', 0))),
                float(values.get('progress_m', 0.0)),
            )

        supervisor.watch(
            lambda quiet_s: processes.statuses()[learner] is not None,
            show_progress,
            may_end=(learner,),
            start_s=START_DEADLINE_S,
        )
        if processes.statuses()[learner] and not composed:
            supervisor.check_simulator(may_end=(learner,))
        processes.wait(learner, _END_S)
    done = make_training(config, folder, resume=True)
    if not done.is_done:
        raise ProcessError(
            f'{config.controller} ended after {done.steps} of {config.training.steps} steps; '
            '--resume goes on'
        )
    return done


def node_parameters(config: TrainConfig, folder: RunFolder) -> dict[str, dict[str, Any]]:
    """Return the parameters of a training's nodes, which wait for each other."""
    simulator, controller = meeting_parameters(config.controller, is_recorded=False)
    seed = {'seed': config.seed}
    learning = {**config.training.to_dict(), 'output': str(folder.path.absolute()), 'resume': True}
    return {
        'simulator': config.simulator.to_dict() | seed | simulator | {'autostart': False},
        config.controller: config.controller_parameters.to_dict()
        | config.filter.node_parameters()
        | seed
        | controller
        | learning,
    }
