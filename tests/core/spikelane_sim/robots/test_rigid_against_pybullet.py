"""How far the planar rigid body and the robot in pybullet agree, over all commands.

Distances are between the places of base_link at the same time, in percent of the path that
pybullet's robot has driven until then. The closed loop over many seeds is compared in
docs/results/rigid.md.
"""

import numpy as np
from numpy.typing import NDArray
import pytest

from spikelane_sim.contract import WheelVelocities
from spikelane_sim.robots import make_robot, RobotParameters

FASTEST = {'p3dx': 12.3, 'turtlebot4': 8.56}


def places(model: str, engine: str, commands: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return x and y of base_link after each step, beginning with the start, (n + 1, 2)."""
    robot = make_robot(RobotParameters.from_mapping({'model': model, 'engine': engine}))
    poses = [robot.step(WheelVelocities(*pair)) for pair in commands.tolist()]
    robot.close()
    return np.concatenate([np.zeros((1, 2)), np.concatenate(poses)[:, :2]])


def most_apart_percent(model: str, commands: NDArray[np.float64], from_m: float) -> float:
    """Return the largest distance of a drive, once a path of from_m has been driven."""
    physics, rigid = (places(model, engine, commands) for engine in ('pybullet', 'rigid'))
    path = np.concatenate([[0.0], np.hypot(*np.diff(physics, axis=0).T).cumsum()])
    apart = np.hypot(*(rigid - physics).T)
    assert path[-1] > 2 * from_m
    return float((100 * apart / np.maximum(path, 1e-9))[path > from_m].max())


def held(generator: np.random.Generator, low: float, high: float) -> NDArray[np.float64]:
    """Return random commands, each held for 1 to 30 steps, (400, 2)."""
    commands = generator.uniform(low, high, (400, 2))
    return np.repeat(commands, generator.integers(1, 31, 400), axis=0)[:400]


@pytest.mark.parametrize('model', ['p3dx', 'turtlebot4'])
@pytest.mark.parametrize('seed', range(3))
def test_in_the_paper_s_range(model: str, seed: int) -> None:
    """0.5 to 2.5 rad/s: within 0.02 % of the path."""
    generator = np.random.default_rng(seed)
    middle, difference = held(generator, 0.5, 2.5)[:, 0], held(generator, -1.0, 1.0)[:, 0]
    commands = np.stack([middle - difference / 2, middle + difference / 2], axis=1)
    assert most_apart_percent(model, commands, 0.3) < 0.02


@pytest.mark.parametrize('model', ['p3dx', 'turtlebot4'])
@pytest.mark.parametrize('low', [-1.0, 0.0])
@pytest.mark.parametrize('seed', range(3))
def test_anywhere(model: str, low: float, seed: int) -> None:
    """Up to the fastest, with reversals and without: within 0.2 % of the path."""
    fastest = FASTEST[model]
    commands = held(np.random.default_rng(seed), low * fastest, fastest)
    assert most_apart_percent(model, commands, 0.5) < 0.2


@pytest.mark.parametrize('model', ['p3dx', 'turtlebot4'])
@pytest.mark.parametrize(
    'wheels',
    [(1.0, 1.0), (1.0, 0.0), (0.0, 1.0), (1.0, 0.7), (-1.0, -1.0), (-0.3, 1.0), (-1.0, 0.2)],
)
def test_from_rest_to_the_fastest(model: str, wheels: tuple[float, float]) -> None:
    """Straight on, round a standing wheel, backwards, in narrow circles: within 0.02 %."""
    commands = np.tile(np.multiply(wheels, FASTEST[model]), (60, 1))
    assert most_apart_percent(model, commands, 0.1) < 0.02


def test_full_reversals_while_turning() -> None:
    """The hardest commands go from one extreme to the other, some before it is reached."""
    generator = np.random.default_rng(0)
    corners = generator.choice([-12.3, -4.0, 0.0, 4.0, 12.3], (40, 2))
    commands = np.repeat(corners, generator.integers(5, 40, 40), axis=0)
    assert most_apart_percent('p3dx', commands, 0.5) < 0.2
