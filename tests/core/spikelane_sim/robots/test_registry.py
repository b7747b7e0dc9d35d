"""Robots and engines by name: former names, and engines of other packages."""

import json
from pathlib import Path
import subprocess
import sys

import pytest

from spikelane.experiment.plan import _key_in
from spikelane_sim.errors import ParameterError
from spikelane_sim.robots import RobotParameters
from spikelane_sim.simulator_parameters import current_config, SimulatorParameters

FORMER = {
    'robot.model': 'kinematic',
    'robot.wheel_friction': 0.5,
    'robot.physics_step_s': 0.001,
    'robot.solver_iterations': 70,
    'robot.track_m': 0.4,
}
TODAY = {
    'robot.model': 'p3dx',
    'robot.engine': 'kinematic',
    'robot.pybullet.wheel_friction': 0.5,
    'robot.pybullet.physics_step_s': 0.001,
    'robot.pybullet.solver_iterations': 70,
    'robot.track_m': 0.4,
}

#: An engine that stands still, and an entry point that names nothing.
PACKAGE = """
from dataclasses import dataclass
from spikelane_sim.engine import Engine
from spikelane_sim.parameters import parameter, Parameters

@dataclass(frozen=True, kw_only=True)
class AnchorParameters(Parameters):
    chain_m: float = parameter(3.0, 'Length of the chain', unit='m', low=0.0)

class Anchored:
    def __init__(self, parameters, poses_per_step, period_s):
        self.chain_m = parameters.own(AnchorParameters).chain_m

ENGINE = Engine(Anchored, AnchorParameters)
"""
POINTS = '[spikelane.engines]\nanchor = anchor:ENGINE\nsunk = nowhere:ENGINE\n'


def test_former_names_mean_what_they_meant() -> None:
    """Dotted, nested, and in what determined a run."""
    assert SimulatorParameters.from_mapping(FORMER).to_dict().items() >= TODAY.items()
    nested = {'robot': {name.partition('.')[2]: value for name, value in FORMER.items()}}
    assert SimulatorParameters.from_mapping(nested).to_dict().items() >= TODAY.items()
    config = {'seed': 3, 'simulator': {**FORMER, 'of.another_version': 1}}
    later = {'period_ms': 50, 'speed': 1.0}
    wanted = {'seed': 3, 'simulator': {**TODAY, **later, 'of.another_version': 1}}
    assert current_config(config) == wanted
    assert current_config(wanted) == wanted


def test_todays_name_counts_where_both_are_given() -> None:
    """In whichever order."""
    both = {'wheel_friction': 0.5, 'pybullet.wheel_friction': 0.7}
    for given in (both, dict(reversed(both.items()))):
        made = RobotParameters.from_mapping(given).to_dict()
        assert made['pybullet.wheel_friction'] == 0.7


def test_an_engine_given_twice_is_refused() -> None:
    """Nobody can say which one is meant."""
    with pytest.raises(ParameterError, match=r"^model: expected one of p3dx.*, got 'kinematic'$"):
        RobotParameters.from_mapping({'model': 'kinematic', 'engine': 'pybullet'})


def test_a_run_of_an_experiment_of_an_earlier_version_is_found_again(tmp_path: Path) -> None:
    """By its configuration, and by that of the run before it."""
    keys = []
    for simulator in (FORMER, TODAY):
        before = {'task': 'train', 'configuration': {'simulator': simulator}, 'before': None}
        identity = {'task': 'lap', 'configuration': {'simulator': simulator}, 'before': before}
        file = tmp_path / 'run.json'
        file.write_text(json.dumps({'identity': identity}))
        keys.append(_key_in(file))
    assert keys[0] == keys[1] != ''


def test_another_package_adds_an_engine_with_parameters_of_its_own(tmp_path: Path) -> None:
    """One module and one entry point; one that cannot be imported is told where it is used."""
    (tmp_path / 'anchor.py').write_text(PACKAGE)
    installed = tmp_path / 'anchor-1.0.dist-info'
    installed.mkdir()
    (installed / 'METADATA').write_text('Metadata-Version: 2.1\nName: anchor\nVersion: 1.0\n')
    (installed / 'entry_points.txt').write_text(POINTS)
    code = (
        f'import sys; sys.path.insert(0, {str(tmp_path)!r})\n'
        'from spikelane_sim.robots import make_robot, RobotParameters\n'
        "own = {'engine': 'anchor', 'anchor.chain_m': 7}\n"
        'print(make_robot(RobotParameters.from_mapping(own)).chain_m)\n'
        "make_robot(RobotParameters(engine='sunk'))\n"
    )
    ended = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=False
    )
    assert ended.stdout == '7.0\n'
    assert ended.stderr.endswith(
        'robot.engine: sunk cannot be used: expected nowhere:ENGINE, '
        'got ModuleNotFoundError("No module named \'nowhere\'")\n'
    )
