"""Checks a controller against the whole contract: in one process and over ROS."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
import tempfile
from typing import Any

from spikelane.runs.configuration import group_values, Request
from spikelane.runs.folder import RunFolder
from spikelane.runs.lap.config import default_weights, LapConfig
from spikelane.runs.lap.run import drive
from spikelane.runs.lap.trajectory import write_csv
from spikelane.runs.train.config import TrainConfig
from spikelane.runs.train.run import train as train_in
from spikelane.runs.transport import check_transport
from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_controllers.controller_check import check_controller, Violations
from spikelane_controllers.registry import controller_class, training_class, training_names
from spikelane_sim.errors import ParameterError

#: Steps of the laps and, as its class counts them, of the trainings.
STEPS = 60

_SHORT: Mapping[str, Any] = {
    'simulator.robot.engine': 'kinematic',
    'simulator.episode.max_steps': STEPS,
}
_SEED = 7


def check(name: str, transport: str, parameters: Mapping[str, Any]) -> list[str]:
    """Check a registered controller.

    Args:
        name: Name of the controller, in the registry.
        transport: 'inprocess', or 'ros' or 'composed' for that, too.
        parameters: Its parameters as `name.parameter`, and those of its training as
            `training.save_every`; what is absent is default.

    Returns:
        All violations, one sentence each.

    Raises:
        SpikelaneError: The controller is not found, a parameter is not allowed, or there is no
            ROS where it is asked for.
    """
    check_transport(transport, name)
    given = {**default_weights('1', name), **parameters}
    learns = name in training_names()
    groups = group_values(given, [name, 'training'] if learns else [name])
    own_training = groups.get('training', {})
    if 'steps' in own_training:
        raise ParameterError('training.steps: expected none, as the check has lengths of its own')
    if learns:  # before anything is driven
        training_class(name).parameters_class.from_mapping(own_training, 'training')
    driving = {key: value for key, value in parameters.items() if key.startswith(f'{name}.')}
    found = check_controller(name, controller_class(name), groups.get(name, {}))
    violations = Violations(name)
    with tempfile.TemporaryDirectory(prefix='spikelane-check-') as folder:
        if transport != 'inprocess':
            with violations.guard('lap over ROS'):
                _check_lap(violations, name, transport, driving, Path(folder))
        if learns:
            with violations.guard('training'):
                _check_training(violations, name, transport, parameters, Path(folder))
    return found + violations.found


def _quiet(step: int, progress: float) -> None:
    del step, progress


def _check_lap(
    violations: Violations,
    name: str,
    transport: str,
    parameters: Mapping[str, Any],
    folder: Path,
) -> None:
    """Check that a short drive over ROS is the same as in one process."""
    asked = Request('1', name, _SEED, 'inprocess', {**parameters, **_SHORT})
    driven = drive(LapConfig.make(asked), RunFolder(folder), _quiet)
    config = LapConfig.make(asked._replace(transport=transport))
    over = drive(config, RunFolder.begin(config, folder / 'lap'), _quiet)
    write_csv(driven.trajectory, folder / 'inprocess.csv')
    write_csv(over.trajectory, folder / 'ros.csv')
    if (folder / 'inprocess.csv').read_bytes() != (folder / 'ros.csv').read_bytes():
        expected = f'the same trajectory of {STEPS} steps as in one process'
        violations.add('lap over ROS', expected, 'another trajectory')


def _check_training(
    violations: Violations,
    name: str,
    transport: str,
    parameters: Mapping[str, Any],
    folder: Path,
) -> None:
    """Check that a training is the same if it is resumed, and over ROS."""
    given = {**parameters, **_SHORT}

    def train(where: str, steps: int, transport: str = 'inprocess') -> bytes:
        config = TrainConfig.make(Request('1', name, _SEED, transport, given), steps)
        is_resumed = (folder / where).exists()
        run = RunFolder(folder / where) if is_resumed else RunFolder.begin(config, folder / where)
        train_in(config, run, _quiet, resume=is_resumed)
        read_checkpoint(run.checkpoint, name)
        return run.checkpoint.read_bytes()

    whole = train('whole', 2 * STEPS)
    with violations.guard('resumed training'):
        train('parts', STEPS - 7)
        if train('parts', 2 * STEPS) != whole:
            expected = 'the checkpoint of a training that was not interrupted'
            violations.add('resumed training', expected, 'another checkpoint')
    if transport != 'inprocess':
        with violations.guard('training over ROS'):
            if train('ros', 2 * STEPS, transport) != whole:
                expected = 'the checkpoint of the same training in one process'
                violations.add('training over ROS', expected, 'another checkpoint')
