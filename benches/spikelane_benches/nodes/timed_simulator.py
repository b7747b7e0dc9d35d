"""The simulator in real time, which notes when each observation went and its answer came.

Prints one JSON object at the end: the delays of the answers in the order of the steps [ms], null
where no answer to a step has come.
"""

from __future__ import annotations

import json
import sys
import time

from spikelane_sim.contract import Observation, WheelVelocities
from spikelane_sim.nodes.running import run_node
from spikelane_sim.nodes.simulator import SimulatorNode

#: Steps after the last one that is looked at, in which its answer may still come.
_MORE = 20


class TimedSimulator(SimulatorNode):
    """Takes so many steps after the first answer, and ends."""

    def __init__(self) -> None:
        """Declare how many steps are looked at, and how many before that are not."""
        self._sent_ns: list[int] = []  # of each step: when its observation went
        self._numbers: dict[int, int] = {}  # of steps, by their stamps
        self._came_ns: dict[int, int] = {}  # by the number of the step
        self._first: int | None = None  # step that was answered first
        super().__init__()
        self._steps = int(self.declare_parameter('bench_steps', 1000).value)
        self._warm_up = int(self.declare_parameter('bench_warm_up', 100).value)
        take = self._stepper.command

        def note(stamp_ns: int | None, wheels: WheelVelocities) -> None:
            self._note(stamp_ns)
            take(stamp_ns, wheels)

        self._stepper.command = note  # type: ignore[method-assign]

    def _publish(self, observation: Observation, is_new: bool) -> None:
        if is_new:
            self._numbers[observation.stamp_ns] = len(self._sent_ns)
            self._sent_ns.append(time.monotonic_ns())
        super()._publish(observation, is_new)
        if self._first is not None and not self.is_done:
            first = self._first + self._warm_up
            if len(self._sent_ns) >= first + self._steps + _MORE:
                self._tell(first)

    def _note(self, stamp_ns: int | None) -> None:
        """Note an answer, in the thread that receives it."""
        number = self._numbers.get(stamp_ns) if stamp_ns is not None else None
        if number is not None:
            self._came_ns.setdefault(number, time.monotonic_ns())
            if self._first is None:
                self._first = number

    def _tell(self, first: int) -> None:
        steps = range(first, first + self._steps)
        sent = self._sent_ns
        delays = [
            (self._came_ns[step] - sent[step]) / 1e6 if step in self._came_ns else None
            for step in steps
        ]
        gaps = [(sent[step + 1] - sent[step]) / 1e6 for step in steps]
        print(json.dumps({'delays_ms': delays, 'gaps_ms': gaps}), flush=True)
        self._stepper.quit()
        self.is_done = True


def main() -> None:
    """Run the node."""
    sys.exit(run_node(TimedSimulator))


if __name__ == '__main__':
    main()
