"""Adam (Kingma and Ba 2015) in PyTorch, for networks so small that its management is what counts.

PyTorch's function does the computation. Its class `torch.optim.Adam` adds hooks and parameter
groups, which these networks do not need: at its first use it imports PyTorch's compiler, which
takes more than a second, and each of its steps takes a multiple of the computation.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch.optim.adam import adam

# The defaults of torch.optim.Adam, those of the publication.
_BETA_1, _BETA_2, _EPSILON = 0.9, 0.999, 1e-8


class Adam:
    """Adam for some tensors; bit for bit `torch.optim.Adam(..., fused=True)`.

    Attributes:
        means: Running averages of the gradients, one for each tensor and of its shape.
        squares: The same of their squares.
    """

    def __init__(self, tensors: Sequence[torch.Tensor]) -> None:
        """Begin with averages of 0.

        Args:
            tensors: What is learnt, of 32-bit floats; they are changed in place.
        """
        self._tensors = list(tensors)
        self.means = [torch.zeros_like(each, requires_grad=False) for each in tensors]
        self.squares = [torch.zeros_like(each, requires_grad=False) for each in tensors]
        # On the tensors' device, as the computation wants it.
        self._steps = [torch.zeros((), device=each.device) for each in tensors]

    def set_steps(self, steps: int) -> None:
        """Say how many steps the averages are of."""
        for each in self._steps:
            each.fill_(steps)

    def step(self, gradients: Sequence[torch.Tensor], learning_rate: float) -> None:
        """Take a step against the gradients, which are one for each tensor and of its shape."""
        with torch.no_grad():
            adam(
                self._tensors,
                list(gradients),
                self.means,
                self.squares,
                [],
                self._steps,
                fused=True,
                amsgrad=False,
                beta1=_BETA_1,
                beta2=_BETA_2,
                lr=learning_rate,
                weight_decay=0.0,
                eps=_EPSILON,
                maximize=False,
            )
