"""Parts of a fleet, each for a thread.

The kernels release the interpreter's lock. So one compiled version serves any number of threads,
and nothing waits for numba's thread pool, of which a process has only one. A thread takes its
robots one after the other, for many steps each: so a robot's state is read from memory once.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
import itertools

from spikelane_sim.errors import SpikelaneError
from spikelane_sim.fleet.kernel import make_scratch, Scratch
from spikelane_sim.fleet.world import World

#: Does something for robots first to last, with arrays of its thread.
Work = Callable[[int, int, Scratch], None]


class Threads:
    """The threads of a fleet."""

    def __init__(self, threads: int, n_robots: int, world: World) -> None:
        """Divide the robots.

        Args:
            threads: How many threads, at least 1; no more than robots are used.
            n_robots: How many robots.
            world: What they share.

        Raises:
            SpikelaneError: There are too few threads.
        """
        if threads < 1:
            raise SpikelaneError(f'threads: expected at least 1, got {threads}')
        threads = min(threads, n_robots)
        bounds = [n_robots * part // threads for part in range(threads + 1)]
        self._parts = [(*pair, make_scratch(world)) for pair in itertools.pairwise(bounds)]
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None

    def run(self, work: Work) -> None:
        """Do some work for all robots, and wait for it."""
        if self._pool is None:
            work(*self._parts[0])
            return
        for part in [self._pool.submit(work, *each) for each in self._parts]:
            part.result()

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()
