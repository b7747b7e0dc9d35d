"""Robots and what moves them: `robot.model` says which robot, `robot.engine` which engine.

How far the engines agree is told in `bullet_drive.py` and docs/robots.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import dataclasses
from dataclasses import dataclass
from typing import Any, ClassVar

from spikelane_sim.contract import Robot
from spikelane_sim.engine import Engine
from spikelane_sim.parameters import parameter, Parameters, ParameterSpec, ParametersT, with_groups
from spikelane_sim.period import PERIOD_MS
from spikelane_sim.robots import registry
from spikelane_sim.robots.own import ENDING
from spikelane_sim.robots.wheel_errors import WheelErrors

PYBULLET = 'pybullet'
KINEMATIC = 'kinematic'
RIGID = 'rigid'
P3DX = 'p3dx'

#: Parameters of a simulator that say by how much wheels are not as the robot takes them to be.
WHEEL_ERRORS = ('robot.left_wheel_factor', 'robot.right_wheel_factor', 'robot.track_factor')

_GROUPS = {
    name: each.parameters_class
    for name, each in registry.engines().items()
    if isinstance(each, Engine) and each.parameters_class is not None
}


@dataclass(frozen=True, kw_only=True)
@with_groups(_GROUPS)
class RobotParameters(Parameters):
    """Everything a robot is made from, in addition to its URDF, which takes the size given here.

    `from_mapping` takes what is not given from the robot that `model` names. Each engine's own
    parameters are a field with its name.
    """

    former_names: ClassVar[Mapping[str, str]] = {
        name: f'{PYBULLET}.{name}'
        for name in ('wheel_friction', 'physics_step_s', 'solver_iterations')
    }

    model: str = parameter(
        P3DX,
        'Model of the robot, or the path of its URDF; its size, its limits and the place of its '
        'camera are the defaults of other parameters.',
        choices=tuple(registry.robot_models()),
        ending=ENDING,
        source='paper section 3.2',
    )
    engine: str = parameter(
        PYBULLET,
        'Engine that moves the robot: rigid-body physics (pybullet), the same physics of a '
        'robot whose wheels cannot slip (rigid), or an ideal differential drive (kinematic).',
        choices=tuple(registry.engines()),
    )
    wheel_radius_m: float = parameter(
        0.0975, 'Radius of the wheels.', unit='m', low=0.01, high=1.0, source="paper's simulation"
    )
    track_m: float = parameter(
        0.331,
        'Distance between the wheels.',
        unit='m',
        low=0.01,
        high=2.0,
        source="paper's simulation",
    )
    axle_x_m: float = parameter(
        0.0445,
        "Distance of the wheels' axle ahead of base_link.",
        unit='m',
        low=-1.0,
        high=1.0,
        source="paper's simulation",
    )
    height_m: float = parameter(
        0.13879,
        'Height of base_link above the floor at rest.',
        unit='m',
        low=0.0,
        high=2.0,
        source="paper's simulation",
    )
    left_wheel_factor: float = parameter(
        1.0,
        'Radius that the left wheel really has, as a multiple of wheel_radius_m.',
        low=0.1,
        high=10.0,
    )
    right_wheel_factor: float = parameter(
        1.0,
        'Radius that the right wheel really has, as a multiple of wheel_radius_m.',
        low=0.1,
        high=10.0,
    )
    track_factor: float = parameter(
        1.0,
        'Distance that the wheels really have, as a multiple of track_m.',
        low=0.1,
        high=10.0,
    )
    max_wheel_velocity_rad_s: float = parameter(
        12.3,
        'Largest wheel velocity that the robot is commanded, in either direction.',
        unit='rad/s',
        low=0.0,
        high=100.0,
        source='a P3-DX drives at most 1.2 m/s, and 1.2 m/s / 0.0975 m is 12.3 rad/s',
    )
    max_sideways_m_s2: float = parameter(
        0.0,
        'Largest sideways acceleration with which the engine rigid makes sure that the wheels '
        'hold; 0: that of a turn about one standing wheel at the largest wheel velocity.',
        unit='m/s^2',
        low=0.0,
        high=100.0,
    )
    # 1 N m brakes at 1.8 m/s^2; from 2.7 m/s^2 on (1.5 N m) the caster would leave the floor.
    wheel_torque_n_m: float = parameter(
        1.0, "Largest torque of a wheel's drive.", unit='N m', low=0.01, high=100.0
    )
    # A rotor of about 7e-6 kg m^2 behind a gear of 38:1 weighs this much at the wheel: four times
    # the wheel itself.
    rotor_inertia_kg_m2: float = parameter(
        0.01,
        "Inertia of a motor's rotor as seen at its wheel.",
        unit='kg m^2',
        low=0.0,
        high=1.0,
    )

    def _check_relations(self) -> None:
        if self.model.endswith(ENDING):
            registry.robot_model(self.model)  # it can be read

    @property
    def wheel_errors(self) -> WheelErrors:
        """By how much the wheels are not as the robot takes them to be."""
        return WheelErrors(self.left_wheel_factor, self.right_wheel_factor, self.track_factor)

    def own(self, cls: type[ParametersT]) -> ParametersT:
        """Return the own parameters of the robot's engine, which are of this class."""
        found = getattr(self, self.engine)
        assert isinstance(found, cls)
        return found

    @classmethod
    def accepted_specs(cls, prefix: str = '') -> Iterator[ParameterSpec]:
        """As in Parameters; `model` may name an engine, as it used to."""
        for spec in super().accepted_specs(prefix):
            is_model = spec.name == f'{prefix}model'
            also = tuple(registry.engines()) if is_model else ()
            yield dataclasses.replace(spec, choices=(*spec.choices, *also))

    @classmethod
    def current(cls, values: Mapping[str, Any]) -> dict[str, Any]:
        """As in Parameters; `model` used to name the engine."""
        found = super().current(values)
        if found.get('model') in registry.engines() and 'engine' not in found:
            found |= {'model': P3DX, 'engine': found['model']}
        return found

    @classmethod
    def chosen_defaults(cls, values: Mapping[str, Any]) -> Mapping[str, Any]:
        """As in Parameters: the values of the robot that `model` names."""
        model = registry.values_of(str(values.get('model', P3DX)))
        return model.drive if model else {}


def make_robot(
    parameters: RobotParameters, poses_per_step: int = 1, period_s: float = PERIOD_MS / 1000
) -> Robot:
    """Make the robot that the parameters describe, placed at the origin.

    Args:
        parameters: What to make.
        poses_per_step: How many poses `step` returns, at equal distances in time.
        period_s: Length of a step.

    Raises:
        ParameterError: Parameters contradict each other, the robot's description,
            poses_per_step or period_s.
    """
    return registry.engine(parameters.engine).make(parameters, poses_per_step, period_s)
