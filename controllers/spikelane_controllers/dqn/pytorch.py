"""PyTorch, which only learning a deep Q-network and its transfer need: it is large."""

from __future__ import annotations

import importlib.util

from spikelane_sim.errors import SpikelaneError


class MissingPyTorchError(SpikelaneError):
    """Something is to be learnt with PyTorch, which is not installed."""

    exit_status = 1


def require_pytorch() -> None:
    """Check that PyTorch can be imported.

    Raises:
        MissingPyTorchError: It is not installed; the message says how to get it.
    """
    if importlib.util.find_spec('torch') is None:
        raise MissingPyTorchError(
            "learning: expected PyTorch, found none: pip install 'spikelane[learn]', "
            'or setup/bootstrap learn in a checkout'
        )
