"""Compiles what many tests use, so that none of them waits for it and no two do it at once.

    python tests/compile_kernels.py

Numba keeps what is compiled; a test that needs something else compiles it itself.
"""

from __future__ import annotations

from typing import Any

import gymnasium

from spikelane.fleet import Fleet
from spikelane_controllers.registry import make_controller
from spikelane_sim.contract import controller_rng
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

LEARNING = {'learning': True, 'checkpoint': ''}
RIGID = {'robot.engine': 'rigid'}


def compile_simulators() -> None:
    """Let single simulators and controllers make two steps each."""
    for values in (RIGID, RIGID | {'pixels.model': 'esim', 'camera.antialias': True}):
        for name, parameters in (('rstdp', LEARNING), ('braitenberg', {}), ('dqn_snn', {})):
            controller: Any = make_controller(name, parameters)
            if parameters:
                controller.initialise(controller_rng(0, 0))
            with Simulator(SimulatorParameters.from_mapping(values, 'simulator')) as simulator:
                observation = simulator.reset(None, 0)
                controller.reset(controller_rng(0, 1))
                for _ in range(2):
                    observation = simulator.step(controller.step(observation))


def compile_fleets() -> None:
    """Let a fleet of each controller, and one of environments, make a step."""
    for name, parameters in (('rstdp', LEARNING), ('braitenberg', {}), ('dqn', LEARNING)):
        with Fleet(name, [0], simulator=RIGID, parameters=parameters) as fleet:
            if parameters:
                fleet.initialise()
            fleet.drive(1)
    environments = gymnasium.make_vec('spikelane/LaneKeeping-v0', num_envs=1, simulator=RIGID)
    environments.reset(seed=0)
    environments.step(environments.action_space.sample())
    environments.close()


if __name__ == '__main__':
    compile_fleets()
    compile_simulators()
