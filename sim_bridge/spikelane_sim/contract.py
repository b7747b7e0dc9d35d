"""What simulators, robots and controllers exchange, in-process and over ROS alike.

A simulator is `reset(lane, seed) -> Observation` and `step(wheels) -> Observation`. A controller
is `reset(rng)` at the start of an episode, then `step(observation) -> WheelVelocities` for every
observation of it, the last one included (nothing is done with that last answer).

Distances are positive when the robot is to the right of the lane's centre, seen in its direction
of travel. Simulation time starts one step after zero, since zero means "no time yet".
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.errors import ParameterError
from spikelane_sim.events import Events


class WheelVelocities(NamedTuple):
    """Target velocities of the wheels.

    The paper states motor speeds in m/s; only rad/s agrees with its lap of about 5,000 steps
    (32 m at 1.0 to 1.5 rad/s times a wheel radius of 0.0975 m), so rad/s it is, everywhere.
    """

    left: float  # [rad/s], forward positive
    right: float  # [rad/s], forward positive


STANDSTILL = WheelVelocities(0.0, 0.0)


class RobotState(NamedTuple):
    """Pose and motion of the robot's body (frame base_link) in the world."""

    position: tuple[float, float, float]  # x, y, z [m]
    orientation: tuple[float, float, float, float]  # quaternion x, y, z, w
    linear: tuple[float, float, float]  # velocity in base_link [m/s]
    angular: tuple[float, float, float]  # velocity in base_link [rad/s]
    wheel_angles: tuple[float, float]  # left, right [rad]
    wheel_velocities: tuple[float, float]  # left, right [rad/s]


class LaneState(NamedTuple):
    """Where the robot is on its lane, and how the episode stands."""

    lane: str  # name of the lane driven, in the course's file
    distance_m: float  # from the lane's centre, right of it positive
    heading_error_rad: float  # robot's heading less the lane's, left positive, [-pi, pi)
    position_m: float  # along the lane's centre from the start of its first section
    section: str  # 'A' to 'F' on the paper's course
    progress_m: float  # along the lane since the reset, counted over laps
    laps: int  # completed since the reset
    episode: int  # counts resets, the first is 1
    step: int  # steps since the reset, 0 in the first observation
    terminated: bool  # the episode is over, `reason` says why
    reason: str  # '', or one of the TERMINATED_ constants


TERMINATED_LANE_LOST = 'lane_lost'
TERMINATED_LAPS_COMPLETE = 'laps_complete'
TERMINATED_STEP_LIMIT = 'step_limit'
TERMINATED_NO_PROGRESS = 'no_progress'
#: On a real robot: a person has put it back before it lost the lane.
TERMINATED_PUT_BACK = 'put_back'


class WheelEncoders(NamedTuple):
    """What the encoders of the wheels measure at the end of a step."""

    angles: tuple[float, float]  # left, right [rad], 0 where the robot was placed
    velocities: tuple[float, float]  # left, right [rad/s], forward positive


#: The sensors that a controller may be given, by their names in `Observation`.
SENSORS = ('events', 'encoders')


class Observation(NamedTuple):
    """What a controller receives after each step: the sensors of SENSORS, and the lane.

    A sensor is given if the controller uses it, see `sensors_of`; another one is None.
    """

    stamp_ns: int  # simulation time at the end of the step
    events: Events  # of this step, in the order of time, row, column; always given
    lane: LaneState | None  # None where nobody knows it: a real camera
    encoders: WheelEncoders | None = None  # at the end of this step


class Robot(Protocol):
    """A differential-drive robot, simulated in steps of the control period."""

    def reset(self, x_m: float, y_m: float, heading_rad: float) -> None:
        """Place the robot, at rest."""

    def step(self, wheels: WheelVelocities) -> NDArray[np.float64]:
        """Drive for one step with these target velocities.

        Returns:
            Poses of the body during the step, (n, 7): x, y, z [m] and quaternion x, y, z, w, the
            last row at the step's end. n is fixed when the robot is made.
        """

    @property
    def state(self) -> RobotState:
        """Pose and motion now."""

    def close(self) -> None:
        """Release what the robot holds."""


class Controller(Protocol):
    """Turns observations into wheel velocities.

    A class that uses other sensors than events names all of them in an attribute `sensors`, as
    ('events', 'encoders'). One with parameters that may be changed while it drives
    (`ParameterSpec.changes`) has a method `change(parameters)`: it is given all of its parameters,
    between two steps, before `reset` where an episode begins.
    """

    def reset(self, rng: np.random.Generator) -> None:
        """Begin an episode; all randomness until the next reset comes from rng."""

    def step(self, observation: Observation) -> WheelVelocities:
        """Answer one observation."""


def sensors_of(controller: object) -> tuple[str, ...]:
    """Return the sensors that a controller, or a class of controllers, uses; of SENSORS.

    Raises:
        ParameterError: It names others.
    """
    found = getattr(controller, 'sensors', SENSORS[:1])
    if not isinstance(found, tuple) or not set(found) <= set(SENSORS):
        raise ParameterError(f'sensors: expected a tuple out of {SENSORS}, got {found!r:.80}')
    return found


def controller_rng(seed: int, episode: int) -> np.random.Generator:
    """Return the generator a controller draws from in an episode.

    It depends on seed and episode alone, so that a run over ROS, in-process or resumed draws
    the same numbers.
    """
    return np.random.default_rng([seed, episode, 1])


def simulator_rng(seed: int, episode: int) -> np.random.Generator:
    """Return the generator that the simulator's noise comes from in an episode."""
    return np.random.default_rng([seed, episode, 0])


def link_rng(seed: int, episode: int) -> np.random.Generator:
    """Return the generator that the losses between robot and controller are drawn from."""
    return np.random.default_rng([seed, episode, 2])


def conditions_rng(seed: int, episode: int) -> np.random.Generator:
    """Return the generator that what varies from episode to episode is drawn from."""
    return np.random.default_rng([seed, episode, 3])
