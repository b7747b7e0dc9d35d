"""What a controller's network has to compute for its decisions, counted while it drives.

A stand-in for energy that no machine is needed for: on neuromorphic hardware a spike costs at each
synapse that it reaches, in a conventional network every weight is multiplied and added for every
decision. Updates of neurons, biases, learning and decoding are not counted.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple


class Operations(NamedTuple):
    """What was done: in a step of 50 ms, or in sum."""

    decisions: int = 0  # times the network was asked what to do
    synaptic: int = 0  # spikes, each counted at every synapse that it reaches
    multiply_accumulates: int = 0  # weights of layers whose inputs are numbers
    active_inputs: int = 0  # of the first of these layers, those that are not 0
    active_multiply_accumulates: int = 0  # without the weights of its inputs that are 0


def sum_operations(operations: Iterable[Operations]) -> Operations:
    """Return the sum."""
    return Operations(*map(sum, zip(Operations(), *operations, strict=True)))


def operations_metrics(total: Operations, time_s: float) -> dict[str, Any]:
    """Describe what was done.

    Args:
        total: In all.
        time_s: Simulated time that it was for [s].

    Returns:
        decisions_per_s; and, for each kind of operation that occurred, its number for each
        decision, where there was one, and for each second of simulated time,
        `<kind>_per_decision` and `<kind>_per_s`.
    """
    kinds = {
        'synaptic_operations': total.synaptic,
        'multiply_accumulates': total.multiply_accumulates,
        'active_inputs': total.active_inputs,
        'active_multiply_accumulates': total.active_multiply_accumulates,
    }
    found = {name: count for name, count in kinds.items() if count}
    return {
        'decisions_per_s': total.decisions / time_s,
        **{
            f'{name}_per_decision': count / total.decisions
            for name, count in found.items()
            if total.decisions
        },
        **{
            f'{name}_per_s': count / time_s
            for name, count in found.items()
            if name != 'active_inputs'  # these are no operations
        },
    }
