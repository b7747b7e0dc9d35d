"""The network: events in, a turn out, with spiking neurons in between."""

from __future__ import annotations

from typing import Any

from norse.torch import LICell, LIFCell, LIFParameters, LIParameters, SequentialState
import torch

INPUTS = 32  # cells of 16 x 16 pixels: 4 rows of 8
HIDDEN = 40
SUBSTEPS = 5  # steps of Norse in a step of the simulator, 50 ms
DT_S = 0.01
#: The inverse of time constants [1/s]: potentials decay in 50 ms, currents in 10 ms.
RATES = {'tau_mem_inv': torch.tensor(20.0), 'tau_syn_inv': torch.tensor(100.0)}


class LaneNetwork(torch.nn.Module):
    """Leaky integrate-and-fire neurons, read out by a leaky integrator."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = SequentialState(
            torch.nn.Linear(INPUTS, HIDDEN),
            LIFCell(LIFParameters(**RATES, alpha=torch.tensor(10.0)), dt=DT_S),
            torch.nn.Linear(HIDDEN, 1),
            LICell(LIParameters(**RATES), dt=DT_S),
        )

    def forward(self, counts: torch.Tensor, state: Any = None) -> tuple[torch.Tensor, Any]:
        """Take one step of the simulator.

        Args:
            counts: Events in each cell, (batch, INPUTS).
            state: State of the network after the step before; None before the first one.

        Returns:
            By how much the left wheel is to be faster than the mean [rad/s], (batch, 1), and the
            state.
        """
        current = counts.sqrt()
        for _ in range(SUBSTEPS):
            turn, state = self.layers(current, state)
        return turn, state
