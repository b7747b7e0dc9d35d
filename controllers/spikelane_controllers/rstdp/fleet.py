"""R-STDP in a fleet: the networks of many robots, learning or not, in one kernel."""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.rstdp.controller import RStdp, RStdpParameters
from spikelane_controllers.spiking.fleet_kernel import (
    drive_together,
    gather,
    let_fly,
    most_inputs,
    TOGETHER,
)
from spikelane_controllers.spiking.plasticity import PlasticNetwork
from spikelane_controllers.spiking.plasticity_lanes import make_arriving, run_several
from spikelane_controllers.spiking.plasticity_window import Workspace
from spikelane_controllers.spiking.spiking_fleet import SpikingFleet
from spikelane_sim.kernel_arrays import borrowed, stack_array


class _Networks(NamedTuple):
    """The networks; rows are robots.

    Attributes:
        work: The arrays of `Workspace`, each with a row for each robot.
        n_flying: How many spikes of `work.flying` count, (n_robots,).
        n_fired: How many spikes of `work.fired` count, (n_robots,).
        is_learning: Whether the weights change, (n_robots,).
        c_r: Dopamine for each metre [1/(ms m)].
        network: As the kernel of the learning synapses has it.
        tables: The same.
        has_overflown: Whether spikes had no room, (n_robots,).
    """

    work: Workspace
    n_flying: NDArray[np.int64]
    n_fired: NDArray[np.int64]
    is_learning: NDArray[np.bool_]
    c_r: float
    network: NDArray[np.void]
    tables: NDArray[np.float64]
    has_overflown: NDArray[np.bool_]


class RStdpFleet(SpikingFleet):
    """The R-STDP controllers of a fleet; see `fleet.ControllerFleet`."""

    controller_class = RStdp

    def _make_networks(self, number: int) -> _Networks:
        first = self.controllers[0].network
        return _Networks(
            work=_rows(number, first, self._parameters),
            n_flying=np.zeros(number, np.int64),
            n_fired=np.zeros(number, np.int64),
            is_learning=np.zeros(number, np.bool_),
            c_r=self._parameters.c_r,
            network=first.network,
            tables=first.tables,
            has_overflown=np.zeros(number, np.bool_),
        )

    def _load_network(self, robot: int, controller: RStdp) -> None:
        networks: _Networks = self._networks
        networks.is_learning[robot] = controller.learning
        networks.n_flying[robot] = controller.network.copy_to(_row(networks.work, robot))

    def _store_network(self, robot: int, controller: RStdp) -> None:
        networks: _Networks = self._networks
        controller.network.copy_from(_row(networks.work, robot), int(networks.n_flying[robot]))

    def _store_step(self, controller: RStdp, distance_m: float) -> None:
        controller.reward = self._parameters.c_r * distance_m

    @staticmethod
    def _kernel(*arguments: Any) -> None:
        _advance(*arguments)


def _rows(number: int, network: PlasticNetwork, parameters: RStdpParameters) -> Workspace:
    """Return the arrays of a workspace, each with a row for each robot."""
    # For the spikes of a step, and for those that are flying when it begins.
    room = 2 * most_inputs(parameters)
    work = network.workspace
    rows = [np.zeros((number, *each.shape), each.dtype) for each in work]
    return Workspace(*rows)._replace(  # type: ignore[arg-type]
        flying=np.zeros((number, room), work.flying.dtype)
    )


def _row(work: Workspace, robot: int) -> Workspace:
    return Workspace(*(each[robot] for each in work))


@numba.njit(cache=True, nogil=True)
def _advance(  # type: ignore[no-untyped-def]
    world, robots, scratch, template, motors, networks, journey, first, last
):
    """Let robots first to last drive, some at a time, as their networks are quicker together."""
    world, robots, scratch = borrowed(world), borrowed(robots), borrowed(scratch)
    motors, networks, journey = borrowed(motors), borrowed(networks), borrowed(journey)
    work = networks.work
    arriving, members = make_arriving(networks.network), stack_array((TOGETHER,), np.int64)
    number, following = 0, first
    while True:
        number, following = gather(journey, members, number, following, last)
        if number == 0:
            return
        for m in range(number):
            i = members[m]
            if not let_fly(
                motors, template, i, work.flying, networks.n_flying, networks.has_overflown
            ):
                return
            # As `RStdp.step` does.
            distance_m = robots.known[i].distance_m
            dopamine = networks.c_r * distance_m if networks.is_learning[i] else 0.0
            work.dopamine[i, 0], work.dopamine[i, 1] = -dopamine, dopamine
        run_several(
            work,
            networks.n_flying,
            networks.n_fired,
            members[:number],
            networks.network,
            networks.tables,
            arriving,
        )
        number = drive_together(
            world,
            robots,
            scratch,
            template,
            motors,
            journey,
            members,
            number,
            work.fired,
            networks.n_fired,
        )
