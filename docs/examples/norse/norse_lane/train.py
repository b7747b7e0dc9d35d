"""Trains the network to answer as R-STDP does: python -m norse_lane.train --out FILE.

R-STDP's answers are collected while it drives on the kinematic robot, pushed to both sides so
that it has something to correct. The network is then trained by gradient descent through time;
Norse replaces the derivative of a spike by that of a smooth function.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from safetensors.torch import save_file
import torch

from norse_lane.network import LaneNetwork
import spikelane
from spikelane_sim.contract import WheelVelocities
from spikelane_sim.encoding import count_events, EncodingParameters
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

PUSH_RAD_S = 0.25  # standard deviation of what is added to a wheel
PUSH_STEPS = 20  # how long a push lasts
SEQUENCE = 30  # steps of the simulator that the gradient goes back
SETTLING = 10  # steps of these in which the network's state forgets how it began
BATCH = 64


def collect(steps: int, seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Drive; return each step's counts, (steps, 32), and R-STDP's turn [rad/s], (steps, 1)."""
    rng = np.random.default_rng(seed)
    teacher = spikelane.make_controller('rstdp', {'checkpoint': 'scenario_1'})
    encoding = EncodingParameters()
    counts, turns = [], []
    parameters = SimulatorParameters.from_mapping({'robot.engine': 'kinematic'})
    with Simulator(parameters) as simulator:
        observation = simulator.reset(seed=seed)
        teacher.reset(rng)
        for step in range(steps):
            if observation.lane.terminated:
                observation = simulator.reset()
            if step % PUSH_STEPS == 0:
                push = PUSH_RAD_S * rng.standard_normal()
            answer = teacher.step(observation)
            counts.append(count_events(observation.events, encoding).ravel())
            turns.append([(answer.left - answer.right) / 2])
            observation = simulator.step(WheelVelocities(answer.left + push, answer.right - push))
    return torch.tensor(np.array(counts), dtype=torch.float32), torch.tensor(turns)


def train(
    network: LaneNetwork, counts: torch.Tensor, turns: torch.Tensor, updates: int
) -> list[float]:
    """Train a network by turns that answer counts; return each update's mean squared error."""
    optimiser = torch.optim.Adam(network.parameters(), lr=0.01)
    errors = []
    for _ in range(updates):
        begin = torch.randint(len(counts) - SEQUENCE, (BATCH,))
        state, loss = None, torch.zeros(())
        for step in range(SEQUENCE):
            turn, state = network(counts[begin + step], state)
            if step >= SETTLING:
                loss = loss + torch.nn.functional.mse_loss(turn, turns[begin + step])
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        errors.append(loss.item() / (SEQUENCE - SETTLING))
    return errors


def main(arguments: Sequence[str] | None = None) -> None:
    """Collect, train, and write the weights."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--steps', type=int, default=20_000, help='steps to collect')
    parser.add_argument('--updates', type=int, default=150)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--out', type=Path, required=True, help='file of the weights')
    options = parser.parse_args(arguments)
    torch.manual_seed(options.seed)
    network = LaneNetwork()
    counts, turns = collect(options.steps, options.seed)
    errors = train(network, counts, turns, options.updates)
    save_file(network.state_dict(), options.out)
    print(f'mean squared error: {errors[0]:.4f} at first, {errors[-1]:.4f} at last')


if __name__ == '__main__':
    main()
