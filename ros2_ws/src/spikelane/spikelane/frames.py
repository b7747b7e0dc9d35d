"""What a run left as tables of pandas: trajectories, events, spikes and weights."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
import pandas as pd

from spikelane.runs.lap.trajectory import Trajectory
from spikelane.runs.lap.trajectory_bag import decode_events, EVENTS, read_messages
from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_controllers.registry import card
from spikelane_sim import topic_names
from spikelane_sim.events import Events, no_events

_CONTROLLER_STATE = f'/{topic_names.CONTROLLER_STATE}'


class StepSpikes(NamedTuple):
    """How often neurons fired in a step."""

    neurons: tuple[str, ...]
    spikes: tuple[int, ...]


def trajectory_frame(trajectory: Trajectory) -> pd.DataFrame:
    """Return a trajectory, one row for each step; the columns are those of `Trajectory`."""
    return pd.DataFrame(trajectory.columns())


def events_frame(steps: Mapping[int, Events]) -> pd.DataFrame:
    """Return the events of steps, one row each.

    Args:
        steps: By the stamp of the step's observation [ns].

    Returns:
        Columns `stamp_ns`, `t_ns`, `x_px`, `y_px` and `polarity`: see `Run.events`.
    """
    events = np.concatenate([no_events(), *steps.values()])
    stamps = np.repeat(np.array([*steps], np.int64), [len(each) for each in steps.values()])
    names = {'t': 't_ns', 'x': 'x_px', 'y': 'y_px', 'polarity': 'polarity'}
    return pd.DataFrame(
        {'stamp_ns': stamps, **{name: events[field] for field, name in names.items()}}
    )


def spikes_frame(steps: Mapping[int, StepSpikes]) -> pd.DataFrame:
    """Return the spikes of steps, one row for each neuron and step.

    Args:
        steps: By the stamp of the step's observation [ns].

    Returns:
        Columns `stamp_ns`, `neuron` and `spikes`: see `Run.spikes`.
    """
    each = [len(step.neurons) for step in steps.values()]
    return pd.DataFrame(
        {
            'stamp_ns': np.repeat(np.array([*steps], np.int64), each),
            'neuron': pd.Categorical([name for step in steps.values() for name in step.neurons]),
            'spikes': np.array([n for step in steps.values() for n in step.spikes], np.int64),
        }
    )


def weights_frame(arrays: Mapping[str, NDArray[Any]]) -> pd.DataFrame:
    """Return arrays of weights, one row for each weight.

    Args:
        arrays: By name, of one axis or two.

    Returns:
        Columns `array`, `row`, `column` and `weight`: see `Run.weights`.
    """
    tables = [_weights_of(name, values) for name, values in arrays.items()]
    return pd.concat(tables, ignore_index=True)


def _weights_of(name: str, values: NDArray[Any]) -> pd.DataFrame:
    rows, columns = np.indices(values.shape if values.ndim == 2 else (len(values), 1))
    return pd.DataFrame(
        {
            'array': name,
            'row': rows.ravel(),
            'column': columns.ravel(),
            'weight': values.astype(np.float64).ravel(),
        }
    )


def recorded_events(bag: Path, stamps_ns: Iterable[int]) -> pd.DataFrame:
    """Return the events of these steps from a recording, as `events_frame`.

    Raises:
        BagError: It cannot be read, or has no events.
    """
    wanted = set(stamps_ns)
    # A packet that was sent again counts once.
    found = {
        each.stamp_ns: decode_events(each.message)
        for each in read_messages(bag, [EVENTS])
        if each.stamp_ns in wanted
    }
    return events_frame(found)


def recorded_spikes(bag: Path, stamps_ns: Iterable[int]) -> pd.DataFrame:
    """Return the spikes of these steps from a recording, as `spikes_frame`.

    Raises:
        BagError: It cannot be read, or has no states of a controller.
    """
    wanted = set(stamps_ns)
    found = {
        each.stamp_ns: StepSpikes(
            tuple(each.message.neurons), tuple(map(int, each.message.spikes))
        )
        for each in read_messages(bag, [_CONTROLLER_STATE])
        if each.stamp_ns in wanted
    }
    return spikes_frame(found)


def learnt_weights(controller: str, checkpoint: Path) -> pd.DataFrame:
    """Return the weights that a controller drives with, as `weights_frame`.

    Raises:
        SpikelaneError: They cannot be read.
    """
    arrays = read_checkpoint(checkpoint, controller).arrays
    return weights_frame({name: arrays[name] for name in card(controller).weight_arrays})
