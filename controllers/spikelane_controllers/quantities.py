"""What a controller can record of itself, step by step, and the form in which it hands it over.

A controller says itself what it offers: `shown.quantities` describes each quantity. One that
offers any has a method `record(names)`, which begins to record these. From then on
`shown.recorded` holds their samples of the last step, by name. Recording changes no answer.

Time within a step is that of the network, counted from the beginning of the step whose
events drive it: that step ends at the observation's stamp.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.shown import shown_by
from spikelane_sim.errors import ParameterError
from spikelane_sim.period import PERIOD_NS

#: In place of names: everything that the controller offers.
ALL = 'all'


class Axis(NamedTuple):
    """An axis of a quantity.

    Attributes:
        name: What its entries are, in the singular: 'neuron', 'input'.
        labels: Name of each entry.
    """

    name: str
    labels: tuple[str, ...]


class Quantity(NamedTuple):
    """A quantity that a controller offers.

    Attributes:
        name: Its name, as a plural where there are several.
        words: What it is.
        unit: Its unit; '1' where it has none, 'ns' for the times of spikes.
        axes: What one sample has values for. Of spikes: the one axis of what fires.
        offsets_ns: When in a step the samples are taken [ns after its beginning]; not used of
            spikes. One that is later than the step's end is at its end.
        is_spikes: Whether it is times of spikes, `SpikeTimes`, and not an array.
    """

    name: str
    words: str
    unit: str
    axes: tuple[Axis, ...]
    offsets_ns: tuple[int, ...] = (PERIOD_NS,)
    is_spikes: bool = False

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array of one step: the samples, then the axes."""
        return (len(self.offsets_ns), *(len(axis.labels) for axis in self.axes))


class SpikeTimes(NamedTuple):
    """Spikes of one step, in the order of time."""

    offsets_ns: NDArray[np.int64]  # after the beginning of the step, (n,)
    sources: NDArray[np.int64]  # what fired, indices of the axis' labels, (n,)


#: What a quantity was in one step: an array of `Quantity.shape`, or spikes.
Sample = NDArray[np.float64] | SpikeTimes


def begin_to_record(name: str, controller: Any, names: Collection[str]) -> tuple[Quantity, ...]:
    """Let a controller record.

    Args:
        name: What the controller is called in errors.
        controller: The controller.
        names: Names of quantities, or `ALL` for everything that it offers; none for nothing.

    Returns:
        The quantities, in the order in which the controller offers them.

    Raises:
        ParameterError: The controller does not offer one of them, or cannot record.
    """
    chosen = chosen_quantities(name, shown_by(controller).quantities, names)
    if chosen and not callable(getattr(controller, 'record', None)):
        raise ParameterError(f'{name}: expected a method record(names), got none')
    if chosen:
        controller.record([each.name for each in chosen])
    return chosen


def checked_sample(quantity: Quantity, samples: Mapping[str, Any]) -> Sample:
    """Return the sample of a quantity, which an own controller may have got wrong.

    Args:
        quantity: The quantity.
        samples: As `shown.recorded` has them.

    Raises:
        ParameterError: It is missing or not what its quantity says.
    """
    sample = samples.get(quantity.name)
    if quantity.is_spikes:
        n_sources = len(quantity.axes[0].labels)
        expected = f'SpikeTimes of sources below {n_sources}, within a step, in the order of time'
        is_right = isinstance(sample, SpikeTimes) and _are_spikes(sample, n_sources)
    else:
        expected = f'an array of the shape {quantity.shape}'
        is_right = np.shape(sample) == quantity.shape  # type: ignore[arg-type]
    if sample is None or not is_right:
        got = 'none' if sample is None else _described(sample)
        raise ParameterError(f'recorded {quantity.name}: expected {expected}, got {got}')
    found: Sample = sample
    return found


def _are_spikes(spikes: SpikeTimes, n_sources: int) -> bool:
    offsets_ns, sources = np.asarray(spikes.offsets_ns), np.asarray(spikes.sources)
    return bool(
        len(offsets_ns) == len(sources)
        and ((offsets_ns >= 0) & (offsets_ns <= PERIOD_NS)).all()
        and (np.diff(offsets_ns) >= 0).all()
        and ((sources >= 0) & (sources < n_sources)).all()
    )


def _described(sample: Any) -> str:
    if isinstance(sample, np.ndarray | list):
        return f'one of {np.shape(sample)}'
    return f'{sample!r:.80}'


def chosen_quantities(
    name: str, offered: Iterable[Quantity], names: Collection[str]
) -> tuple[Quantity, ...]:
    """Return the quantities that are asked for; see `begin_to_record`.

    Raises:
        ParameterError: One of them is not offered.
    """
    known = {each.name: each for each in offered}
    for each in names:
        if (each != ALL and each not in known) or not known:
            expected = f'any of {", ".join(known)}, or {ALL}' if known else 'nothing'
            raise ParameterError(f'record: expected {expected}, which {name} offers, got {each!s}')
    return tuple(each for each in known.values() if each.name in names or ALL in names)
