"""Laps that scripts of results drive, in a fleet or alone, and how they went."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane.fleet import Fleet
from spikelane.loop import drive_episode
from spikelane_sim.contract import (
    LaneState,
    Observation,
    TERMINATED_LAPS_COMPLETE,
    WheelVelocities,
)
from spikelane_sim.filters import FilterParameters
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

LANES = ('outer', 'inner')
#: The seeds of laps begin here: no training has one of them.
LAP_SEED = 1000


class Driven(NamedTuple):
    """A lap that was driven.

    Attributes:
        end: The last lane state.
        distances_m: Lane distance at each observation, the last one included [m], (n,).
    """

    end: LaneState
    distances_m: NDArray[np.float64]

    def result(self, first: int = 0) -> dict[str, Any]:
        """Return how it went, as columns of the data.

        Args:
            first: The first observation that counts in the error.

        Returns:
            completed: whether the lap was; error_m: the mean distance from the lane's centre [m].
        """
        return {
            'completed': self.end.reason == TERMINATED_LAPS_COMPLETE,
            'error_m': float(np.abs(self.distances_m[first:]).mean()),
        }


def give_weights(controller: Any, weights_pa: NDArray[np.float64]) -> None:
    """Give a controller of R-STDP its weights [pA]; all else stays as it is."""
    controller.restore({**controller.state(), 'network.weights_pa': weights_pa})


def host(fleet: Fleet, weights_pa: Sequence[NDArray[np.float64]]) -> None:
    """Give each robot's controller of R-STDP its weights [pA], where there are any."""
    for robot, each in enumerate(weights_pa):
        give_weights(fleet.controller(robot), each)
        fleet.load(robot)


def fleet_laps(fleet: Fleet, lanes: Sequence[str]) -> list[Driven]:
    """Drive a lap with each robot of a fleet, on a lane of its own."""
    return [Driven(track.end, track.places['distance_m']) for track in fleet.episodes(lanes)]


def single_lap(
    simulator: Mapping[str, Any],
    controller: Any,
    lane: str,
    seed: int,
    filters: Mapping[str, Any] | None = None,
) -> Driven:
    """Drive a lap with one robot, where a fleet does not have its controller or its engine.

    Args:
        simulator: Parameters of the simulator, under dotted names.
        controller: Who drives.
        lane: Name of the lane.
        seed: Seed of the simulator and of the controller.
        filters: Parameters of the filters of events, under dotted names; none for no filter.
    """
    distances_m: list[float] = []

    def observe(observation: Observation, _: WheelVelocities) -> None:
        assert observation.lane is not None  # a simulator knows it
        distances_m.append(observation.lane.distance_m)

    with Simulator(SimulatorParameters.from_mapping(simulator)) as driven:
        last = drive_episode(
            driven,
            controller,
            observe,
            lane=lane,
            seed=seed,
            controller_seed=seed,
            filters=FilterParameters.from_mapping(filters or {}),
        )
    assert last.lane is not None
    return Driven(last.lane, np.array(distances_m))
