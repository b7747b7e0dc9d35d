"""The recording of a lap over ROS: made from the bag, with the same numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spikelane.recording.record import facts_of, written
from spikelane.runs.configuration import Configuration, configured_controller
from spikelane.runs.lap.trajectory_bag import read_messages
from spikelane_controllers.quantities import chosen_quantities, Quantity, Sample, SpikeTimes
from spikelane_controllers.shown import shown_by
from spikelane_sim import topic_names
from spikelane_sim.errors import BagError

RECORDED = f'/{topic_names.RECORDED}'


def write_recording(
    config: Configuration,
    bag: Path,
    stamps_ns: Sequence[int],
    record: Sequence[str],
    path: Path,
) -> None:
    """Write what a bag has of a controller as a recording.

    Args:
        config: What was driven.
        bag: Folder of the bag.
        stamps_ns: Stamps of all observations of the drive.
        record: Quantities that were asked for.
        path: The file.

    Raises:
        SpikelaneError: The bag cannot be read or lacks a step, or the file cannot be written.
    """
    offered = shown_by(configured_controller(config)).quantities
    quantities = chosen_quantities(config.controller, offered, record)
    wanted, found = set(stamps_ns), set[int]()
    with written(path, quantities, facts_of(config)) as append:
        for each in read_messages(bag, [RECORDED]):
            # A message that was sent again counts once.
            if each.stamp_ns not in wanted or each.stamp_ns in found:
                continue
            found.add(each.stamp_ns)
            message = each.message
            append(each.stamp_ns, message.episode, message.step, _samples(quantities, message))
        if found != wanted:
            raise BagError(f'{bag}: expected {len(wanted)} steps on {RECORDED}, got {len(found)}')


def _samples(quantities: Sequence[Quantity], message: Any) -> Mapping[str, Sample]:
    """Return the samples of a step."""
    by_name = {each.name: each for each in message.quantities}
    found: dict[str, Sample] = {}
    for quantity in quantities:
        each = by_name[quantity.name]
        if quantity.is_spikes:
            found[quantity.name] = SpikeTimes(
                np.asarray(each.offsets_ns, np.int64), np.asarray(each.sources, np.int64)
            )
        else:
            found[quantity.name] = np.asarray(each.data, np.float64).reshape(quantity.shape)
    return found
