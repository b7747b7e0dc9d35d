"""The states of a simulation, and what a stepper needs of the world around it."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import NamedTuple

from spikelane_sim.contract import Observation


class RunState(Enum):
    """States of a simulation, as in simulation_interfaces."""

    STOPPED = 0  # reset to its beginning, time at 0
    PLAYING = 1
    PAUSED = 2
    QUITTING = 3  # for good: nothing begins any more


class Phase(Enum):
    """What has become of the present observation."""

    NONE = 0  # there is none: no episode has begun
    HELD = 1  # it is not published yet, as a required subscriber is missing
    WAITING = 2  # it is published; in lockstep it waits for its answer
    ANSWERED = 3  # its answer waits for a step, or the episode is over; in lockstep alone


class Publish(NamedTuple):
    """How the stepper reaches the world.

    Attributes:
        observation: Publishes an observation; the flag is false where it was published before.
        has_subscribers: Whether all subscribers are there that must not miss an observation.
        has_controller: Whether anybody could answer.
    """

    observation: Callable[[Observation, bool], None]
    has_subscribers: Callable[[], bool]
    has_controller: Callable[[], bool]


#: Called once: with the observation when it is published, or with None if an episode or a stop
#: came first.
OnPublished = Callable[[Observation | None], None]
