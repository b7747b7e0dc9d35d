"""Parameters that may be changed while what they determine is in use.

A declaration says whether its parameter may be changed, and when a change takes effect:
`parameter(..., changes=NEXT_STEP)`. All others are fixed. A change takes effect between two steps
only, so that it begins with an observation, and a drive can be repeated exactly.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Generic, NamedTuple

from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import NEXT_STEP, Parameters, ParameterSpec, ParametersT


class ParameterChange(NamedTuple):
    """A change that has taken effect."""

    stamp_ns: int  # of the first observation that it holds for
    values: Mapping[str, Any]  # the new ones, by dotted names


class ChangingParameters(Generic[ParametersT]):
    """Parameters in use, the changes asked for, and those that have taken effect.

    One thread may ask for changes while another lets them take effect.

    Attributes:
        parameters: Those in use.
        log: The changes that have taken effect, in this order.
    """

    def __init__(self, parameters: ParametersT) -> None:
        """Begin with these parameters in use."""
        self.parameters = self._wanted = parameters
        self._taken = parameters  # what was wanted at the last step
        self.log: list[ParameterChange] = []

    @property
    def specs(self) -> Mapping[str, ParameterSpec]:
        """The parameters that may be changed, by their names."""
        return {spec.name: spec for spec in changeable_specs(type(self.parameters))}

    def check(self, values: Mapping[str, Any]) -> ParametersT:
        """Return the parameters that a change would lead to.

        Args:
            values: By dotted names.

        Raises:
            ParameterError: A parameter is unknown or fixed, or a value is not allowed, by itself
                or with the others.
        """
        for name in values:
            self._check_name(name)
        new = {**self._wanted.to_dict(), **values}
        wanted = type(self.parameters).from_mapping(new)
        self._at_a_step(wanted)  # where it takes effect before an episode begins
        return wanted

    def change(self, values: Mapping[str, Any]) -> None:
        """Ask for a change: of all values, or of none where one is refused.

        Args:
            values: By dotted names.

        Raises:
            ParameterError: As in `check`.
        """
        if values:
            self._wanted = self.check(values)

    def take_effect(self, stamp_ns: int, *, begins_episode: bool) -> bool:
        """Let what was asked for take effect, as far as its time has come.

        Args:
            stamp_ns: Stamp of the observation that comes next.
            begins_episode: Whether it is the first one of an episode.

        Returns:
            Whether `parameters` are others now.
        """
        wanted, before = self._wanted, self.parameters
        # Most steps end here. What waits for an episode is not looked at again in every step.
        if wanted is before or (wanted is self._taken and not begins_episode):
            return False
        self._taken = wanted
        self.parameters = wanted if begins_episode else self._at_a_step(wanted)
        old, new = before.to_dict(), self.parameters.to_dict()
        changed = {name: value for name, value in new.items() if value != old[name]}
        if changed:
            self.log.append(ParameterChange(stamp_ns, changed))
        return bool(changed)

    def _at_a_step(self, wanted: ParametersT) -> ParametersT:
        """Return the parameters in use with what is wanted from the next step on."""
        new = wanted.to_dict()
        now = {name: new[name] for name, spec in self.specs.items() if spec.changes == NEXT_STEP}
        return type(wanted).from_mapping({**self.parameters.to_dict(), **now})

    def _check_name(self, name: str) -> None:
        kind = type(self.parameters)
        if name not in {spec.name for spec in kind.specs()}:
            raise ParameterError(f'unknown parameter {name!r}')
        if name not in self.specs:
            raise ParameterError(fixed_reason(name, self.specs))


def changeable_specs(parameters: type[Parameters]) -> Iterator[ParameterSpec]:
    """Yield the parameters of a class that may be changed."""
    return (spec for spec in parameters.specs() if spec.changes)


def fixed_reason(name: str, changeable: Mapping[str, ParameterSpec]) -> str:
    """Return why a parameter cannot be changed.

    Args:
        name: The parameter.
        changeable: What can be changed in its stead, by name.
    """
    others = ', '.join(changeable)
    only = f'; only {others} can be changed' if others else ''
    return f'{name}: fixed since the start{only}'
