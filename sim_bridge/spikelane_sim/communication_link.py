"""What lies between a robot and its controller: events get lost, commands come late.

Without delay the answer to an observation drives the wheels in the very next step. With a delay of
n steps the answers to the last n observations are on their way; until the first arrives the wheels
stand still. Where the delay grows while driving, the last command that has arrived holds until the
next one does; where it shrinks, commands that a later one overtakes are dropped. Events are lost
one by one, each with the same probability, whatever the others do.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from spikelane_sim.contract import STANDSTILL, WheelVelocities
from spikelane_sim.errors import ParameterError
from spikelane_sim.events import Events
from spikelane_sim.parameters import NEXT_STEP, parameter, Parameters
from spikelane_sim.period import PERIOD_MS


@dataclass(frozen=True, kw_only=True)
class LinkParameters(Parameters):
    """The connection between robot and controller."""

    latency_ms: int = parameter(
        0,
        'Latency added between an observation and its command; a multiple of the control period.',
        unit='ms',
        low=0,
        high=60_000,
        changes=NEXT_STEP,
    )
    event_loss: float = parameter(
        0.0, 'Share of the events that is lost.', low=0.0, high=1.0, changes=NEXT_STEP
    )

    def latency_steps(self, period_ms: int) -> int:
        """Return the steps from an observation to its command, beyond the usual.

        Args:
            period_ms: Control period.

        Raises:
            ParameterError: The latency is no multiple of the period.
        """
        # Robots are given one pair of velocities a step, so none can take effect within one.
        if self.latency_ms % period_ms:
            raise ParameterError(
                f'link.latency_ms: expected a multiple of {period_ms} ms, the control period, '
                f'got {self.latency_ms}'
            )
        return self.latency_ms // period_ms


class CommunicationLink:
    """Carries events to the controller and commands to the robot."""

    def __init__(self, parameters: LinkParameters, period_ms: int = PERIOD_MS) -> None:
        self.parameters = parameters
        parameters.latency_steps(period_ms)  # refuses one that does not fit
        self._period_ms = period_ms
        self._on_the_way: deque[WheelVelocities] = deque()
        self._arrived = STANDSTILL
        self._rng: np.random.Generator | None = None

    def reset(self, rng: np.random.Generator) -> None:
        """Begin an episode: nothing is on its way; losses are drawn from rng."""
        self._rng = rng
        self._on_the_way.clear()
        self._arrived = STANDSTILL

    def carry_events(self, events: Events) -> Events:
        """Return those events, (N,), that reach the controller."""
        loss = self.parameters.event_loss
        if not loss:
            return events
        assert self._rng is not None  # every episode begins with a reset
        return events[self._rng.random(len(events)) >= loss]

    def carry_command(self, wheels: WheelVelocities) -> WheelVelocities:
        """Send a command; return the one that arrives."""
        self._on_the_way.append(wheels)
        while len(self._on_the_way) > self.parameters.latency_steps(self._period_ms):
            self._arrived = self._on_the_way.popleft()
        return self._arrived
