"""Adam for small networks is PyTorch's, bit for bit, without what is slow around it."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import torch

from spikelane_controllers.learning.adam import Adam

SHAPES = ((7, 3), (7,), (2, 7))
RATES = (1e-3, 1e-3, 5e-4, 0.0, 2e-3)


def tensors(seed: int) -> list[torch.Tensor]:
    """Return a tensor of each shape, of random numbers."""
    rng = np.random.default_rng(seed)
    return [torch.tensor(rng.normal(size=shape), dtype=torch.float32) for shape in SHAPES]


def test_steps_are_those_of_pytorch() -> None:
    """Weights and averages are the same bits, with a rate that changes."""
    ours = tensors(0)
    theirs = [torch.nn.Parameter(each.clone()) for each in ours]
    adam, oracle = Adam(ours), torch.optim.Adam(theirs, fused=True)
    for number, rate in enumerate(RATES):
        gradients = tensors(1 + number)
        for tensor, gradient in zip(theirs, gradients, strict=True):
            tensor.grad = gradient.clone()
        oracle.param_groups[0]['lr'] = rate
        oracle.step()
        adam.step(gradients, rate)
        for k, tensor in enumerate(theirs):
            assert torch.equal(ours[k], tensor)
            assert torch.equal(adam.means[k], oracle.state[tensor]['exp_avg'])
            assert torch.equal(adam.squares[k], oracle.state[tensor]['exp_avg_sq'])


def test_the_first_step_is_as_long_as_the_rate() -> None:
    """Each weight moves by the learning rate against the sign of its gradient (section 2)."""
    weights = torch.zeros(2)
    Adam([weights]).step([torch.tensor([0.25, -8.0])], 0.01)
    np.testing.assert_allclose(weights.numpy(), [-0.01, 0.01], rtol=1e-5)


def test_it_goes_on_where_another_one_stopped() -> None:
    """With its weights, its averages and its number of steps."""
    whole, first = tensors(0), tensors(0)
    adam, before = Adam(whole), Adam(first)
    for seed in (1, 2):
        adam.step(tensors(seed), 1e-3)
        before.step(tensors(seed), 1e-3)
    after = Adam(first)
    for to, values in zip(
        (*after.means, *after.squares), (*before.means, *before.squares), strict=True
    ):
        to.copy_(values)
    after.set_steps(2)
    adam.step(tensors(3), 1e-3)
    after.step(tensors(3), 1e-3)
    assert all(torch.equal(ours, theirs) for ours, theirs in zip(whole, first, strict=True))


def test_no_compiler_is_imported() -> None:
    """Its import would take longer than many trainings."""
    code = """
import sys
import torch
from spikelane_controllers.learning.adam import Adam
weights = torch.zeros(2, requires_grad=True)
Adam([weights]).step([torch.ones(2)], 0.1)
sys.exit('torch._dynamo' in sys.modules)
"""
    subprocess.run([sys.executable, '-c', code], check=True)
