"""Checks what a controller offers to record, as a part of its contract (`controller_check`)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from spikelane_controllers.quantities import ALL, begin_to_record, checked_sample, Quantity
from spikelane_controllers.shown import shown_by
from spikelane_sim.contract import Controller
from spikelane_sim.errors import ParameterError

#: Drives a controller and returns its answers; it calls the function after each.
Drive = Callable[[Controller, Callable[[], None]], Any]


def check_recording(make: Callable[[], Controller], drive: Drive) -> None:
    """Check that a controller records what it offers, and that this changes no answer.

    Args:
        make: Makes the controller, always alike.
        drive: Drives it, always alike.

    Raises:
        ParameterError: It does not.
    """
    recording = make()
    quantities = shown_by(recording).quantities
    if not isinstance(quantities, tuple) or not all(isinstance(q, Quantity) for q in quantities):
        raise ParameterError(
            f'shown.quantities: expected a tuple of Quantity, got {quantities!r:.80}'
        )
    if not quantities:
        return
    names = [each.name for each in quantities]
    if len(set(names)) < len(names):
        raise ParameterError(f'shown.quantities: expected different names, got {", ".join(names)}')
    begin_to_record('shown.quantities', recording, [ALL])

    def check_samples() -> None:
        for quantity in quantities:
            checked_sample(quantity, shown_by(recording).recorded)

    if repr(drive(recording, check_samples)) != repr(drive(make(), lambda: None)):
        raise ParameterError('expected the same answers with a recording, got different ones')
