"""A robot and a camera of somebody else's in the simulator."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
import pytest

from spikelane_sim.camera import Camera, CameraParameters
from spikelane_sim.contract import RobotState, sensors_of, WheelVelocities
from spikelane_sim.course import load_course
from spikelane_sim.errors import ParameterError, SpikelaneError
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

PARAMETERS = SimulatorParameters.from_mapping({'camera': {'width': 32, 'height': 16}})


def test_observations_have_the_encoders_that_are_asked_for() -> None:
    """What the robot's state says at the step's end; without asking there are none."""
    values = SimulatorParameters.from_mapping({'robot.engine': 'kinematic'})
    wheels = WheelVelocities(2.0, 1.0)
    with Simulator(values, sensors=('events', 'encoders')) as measured, Simulator(values) as bare:
        assert measured.reset('outer', 1).encoders == ((0.0, 0.0), (0.0, 0.0))
        assert measured.step(wheels).encoders == ((0.1, 0.05), (2.0, 1.0))
        assert measured.step(wheels).encoders == ((0.2, 0.1), (2.0, 1.0))
        assert bare.reset('outer', 1).encoders is None
        assert bare.step(wheels).encoders is None


@pytest.mark.parametrize('sensors', [('events', 'sonar'), 'events', None])
def test_a_class_with_unknown_sensors_is_refused(sensors: object) -> None:
    """Also where the attribute is no tuple."""
    with pytest.raises(ParameterError, match=r"^sensors: expected a tuple out of \('events', "):
        sensors_of(type('Wrong', (), {'sensors': sensors}))
    assert sensors_of(object()) == ('events',)


class Sled:
    """Slides along its heading, 1 cm in a step for each rad/s of the left wheel."""

    def __init__(self) -> None:
        self.is_closed = False
        self.reset(0.0, 0.0, 0.0)

    def reset(self, x_m: float, y_m: float, heading_rad: float) -> None:
        """Place it."""
        self._pose = np.array(
            [x_m, y_m, 0.1, 0.0, 0.0, math.sin(heading_rad / 2), math.cos(heading_rad / 2)]
        )
        self._heading_rad = heading_rad

    def step(self, wheels: WheelVelocities) -> NDArray[np.float64]:
        """Slide for one step."""
        self._pose[0] += 0.01 * wheels.left * math.cos(self._heading_rad)
        self._pose[1] += 0.01 * wheels.left * math.sin(self._heading_rad)
        return self._pose[None].copy()

    @property
    def state(self) -> RobotState:
        """Pose now; wheels it has none."""
        x, y, z, *orientation = self._pose.tolist()
        still = (0.0, 0.0, 0.0)
        return RobotState((x, y, z), tuple(orientation), still, still, (0.0, 0.0), (0.0, 0.0))

    def close(self) -> None:
        """Note that it was closed."""
        self.is_closed = True


class Blinking(Camera):
    """Sees a bright image in every second call, a dark one in the others."""

    calls = 0
    shape = (16, 32)

    def render_many(self, poses, out=None):  # type: ignore[no-untyped-def]
        """Return images that are all bright, or all dark."""
        self.calls += 1
        return np.full((len(poses), *self.shape), self.calls % 2, np.float32)


def blinking() -> Blinking:
    """Make that camera."""
    return Blinking(CameraParameters(width=32, height=16), load_course('scenario_1'))


def test_a_robot_of_somebody_elses_is_driven_and_closed() -> None:
    """50 steps at 2 rad/s are 1 m along its straight lane."""
    robot = Sled()
    with Simulator(PARAMETERS, robot=robot) as simulator:
        simulator.reset('outer', 0)
        for _ in range(50):
            observation = simulator.step(WheelVelocities(2.0, 0.0))
        assert observation.lane is not None
        assert observation.lane.progress_m == pytest.approx(1.0, abs=1e-9)
        assert simulator.robot_state.position[2] == 0.1
    assert robot.is_closed


def test_a_camera_of_somebody_elses_makes_the_events() -> None:
    """All 512 pixels fire, OFF and ON in turn, though the robot stands."""
    with Simulator(PARAMETERS, robot=Sled(), camera=blinking()) as simulator:
        simulator.reset('outer', 0)
        first, second = (simulator.step(WheelVelocities(0.0, 0.0)).events for _ in range(2))
    assert (len(first), len(second)) == (512, 512)
    assert set(first['polarity'].tolist()) == {-1}
    assert set(second['polarity'].tolist()) == {1}


def test_a_camera_of_another_size_is_refused() -> None:
    """The message has both shapes."""
    camera = blinking()
    camera.shape = (8, 8)
    with (
        Simulator(PARAMETERS, camera=camera, robot=Sled()) as simulator,
        pytest.raises(SpikelaneError, match=r'expected .*16.*32.*got .*8.*8'),
    ):
        simulator.reset('outer', 0)
