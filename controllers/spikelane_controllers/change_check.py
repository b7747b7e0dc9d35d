"""Checks that the parameters of a controller which may be changed can be."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
from typing import Any

from spikelane_sim.contract import Controller
from spikelane_sim.errors import ParameterError
from spikelane_sim.parameter_changes import changeable_specs, ChangingParameters
from spikelane_sim.parameters import Parameters, ParameterSpec


def check_changes(
    make: Callable[[Parameters], Controller],
    parameters: Parameters,
    drive: Callable[[Controller], object],
) -> None:
    """Check that a change before an episode leads to what a start with the new value leads to.

    Args:
        make: Makes a controller.
        parameters: What it is made from first.
        drive: Drives an episode, its reset included; returns the answers.

    Raises:
        ParameterError: It does not, or there is no method `change`.
    """
    for spec in changeable_specs(type(parameters)):
        for new in _others(spec, parameters):
            changed: Any = make(parameters)
            changeable(changed, spec)(new)
            if repr(drive(changed)) != repr(drive(make(new))):
                raise ParameterError(
                    f'{spec.name}: expected the same answers after a change as from the start, '
                    'got different ones'
                )


def changeable(controller: object, spec: ParameterSpec) -> Callable[[Parameters], None]:
    """Return the method of a controller that takes other parameters.

    Args:
        controller: The controller.
        spec: One of its parameters that may be changed.

    Raises:
        ParameterError: It has no such method.
    """
    method = getattr(controller, 'change', None)
    if not callable(method):
        raise ParameterError(
            f'{spec.name}: expected a method change(parameters) of the controller, since the '
            f'parameter may be changed, got {"none" if method is None else repr(method)[:80]}'
        )
    return method  # type: ignore[no-any-return]  # the controller is foreign code


def _others(spec: ParameterSpec, parameters: Parameters) -> Iterator[Parameters]:
    """Yield parameters with one other value, where one that is allowed is found."""
    value = parameters.to_dict()[spec.name]
    candidates: list[Any] = [*spec.choices, spec.default, spec.low, spec.high]
    if spec.kind is bool:
        candidates = [not value]
    elif spec.kind in (int, float):
        candidates = [spec.kind(value / 2), value * 2, *candidates]
    for other in candidates:
        if other is not None and other != value:
            with contextlib.suppress(ParameterError):
                yield ChangingParameters(parameters).check({spec.name: other})
                return
