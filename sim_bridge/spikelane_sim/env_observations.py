"""What the Gymnasium environment may show of an action's steps: one class for each kind.

The first two are the inputs of the paper's controllers, the others are what common libraries of
reinforcement learning take: an image for convolutional networks, and a dictionary of sensors.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Protocol

from gymnasium import spaces
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.contract import Observation
from spikelane_sim.encoding import (
    count_events,
    EncodingParameters,
    StateImage,
    StateImageParameters,
)
from spikelane_sim.simulator_parameters import SimulatorParameters

_POLARITIES = 2
_MOST_COUNTED = 255


class EnvObservation(Protocol):
    """Gathers steps into what the environment returns."""

    @property
    def space(self) -> spaces.Space[Any]:
        """Where the observations are."""

    @property
    def sensors(self) -> tuple[str, ...]:
        """The sensors that the simulator must give, of `spikelane_sim.contract.SENSORS`."""

    def begin(self, observation: Observation) -> None:
        """Forget all steps, and take the first observation of an episode."""

    def add(self, observation: Observation) -> None:
        """Take the observation of a step."""

    def value(self) -> Any:
        """Return what is observed now; the caller may keep and change it."""


class StateImageObservation:
    """Cells of 4 x 4 pixels with an event in the last 0.5 s (the deep Q-network's state)."""

    sensors = ('events',)

    def __init__(self, parameters: SimulatorParameters) -> None:
        camera = parameters.camera
        cells = StateImageParameters(width=camera.width, height=camera.height)
        self._image = StateImage(cells, parameters.steps_of(cells.frames, cells.frame_ms))
        shape = (self._image.parameters.rows, self._image.parameters.columns)
        self.space = spaces.Box(0, 1, shape, np.uint8)

    def begin(self, observation: Observation) -> None:
        """Forget all steps: an episode's first observation has no events."""
        del observation
        self._image.clear()

    def add(self, observation: Observation) -> None:
        """Take the events of a step."""
        self._image.add(observation.events)

    def value(self) -> NDArray[np.uint8]:
        """Return 1 where a cell had an event, (16, 32) for a sensor of 128 x 128 pixels."""
        return self._image.binary


class SpikeCountsObservation:
    """Events of the last step in cells of 16 x 16 pixels (the spiking networks' input)."""

    sensors = ('events',)

    def __init__(self, parameters: SimulatorParameters) -> None:
        camera = parameters.camera
        self._cells = EncodingParameters(width=camera.width, height=camera.height)
        # Only a pixel model that gives several events per pixel and step can exceed cell ** 2.
        most = self._cells.cell**2 if parameters.pixels.model == 'coppelia' else 2**31
        self.space = spaces.Box(0, most, (self._cells.rows, self._cells.columns), np.int64)

    def begin(self, observation: Observation) -> None:
        """Take the first observation of an episode."""
        self.add(observation)

    def add(self, observation: Observation) -> None:
        """Take the events of a step."""
        self._events = observation.events

    def value(self) -> NDArray[np.int64]:
        """Return the counts, (4, 8) for a sensor of 128 x 128 pixels."""
        return count_events(self._events, self._cells)


class EventImageObservation:
    """ON and OFF events of each pixel in the last 0.5 s, an image for convolutions."""

    sensors = ('events',)

    def __init__(self, parameters: SimulatorParameters) -> None:
        camera = parameters.camera
        shape = (_POLARITIES, camera.height, camera.width)
        self.space = spaces.Box(0, _MOST_COUNTED, shape, np.uint8)
        # The window is that of the deep Q-network.
        window = StateImageParameters(width=camera.width, height=camera.height)
        steps = parameters.steps_of(window.frames, window.frame_ms)
        self._places: deque[NDArray[np.int64]] = deque(maxlen=steps)

    def begin(self, observation: Observation) -> None:
        """Forget all steps: an episode's first observation has no events."""
        del observation
        self._places.clear()

    def add(self, observation: Observation) -> None:
        """Take the events of a step."""
        events = observation.events
        _, height, width = self.space.shape
        rows = (events['polarity'] <= 0).astype(np.int64) * height + events['y']
        self._places.append(rows * width + events['x'])

    def value(self) -> NDArray[np.uint8]:
        """Return the numbers of events, at most 255, (2, height, width): ON, then OFF."""
        shape = self.space.shape
        places = np.concatenate(self._places) if self._places else np.zeros(0, np.int64)
        counts = np.bincount(places, minlength=int(np.prod(shape))).reshape(shape)
        return np.minimum(counts, _MOST_COUNTED).astype(np.uint8)


class SensorsObservation:
    """A dictionary of sensors: `events`, the event image, and `wheels`, the encoders."""

    sensors = ('events', 'encoders')

    def __init__(self, parameters: SimulatorParameters) -> None:
        self._events = EventImageObservation(parameters)
        # The robot's limit is that of its commands; a wheel may overshoot it for a moment.
        limit = 2 * parameters.robot.max_wheel_velocity_rad_s
        self._wheels = spaces.Box(-limit, limit, (2,), np.float32)
        self.space = spaces.Dict({'events': self._events.space, 'wheels': self._wheels})

    def begin(self, observation: Observation) -> None:
        """Take the first observation of an episode."""
        self._events.begin(observation)
        self._encoders = observation.encoders

    def add(self, observation: Observation) -> None:
        """Take the events and the encoders of a step."""
        self._events.add(observation)
        self._encoders = observation.encoders

    def value(self) -> dict[str, NDArray[Any]]:
        """Return the event image, and the velocities of both wheels [rad/s], left and right."""
        assert self._encoders is not None  # the simulator has been told to give them
        wheels = np.array(self._encoders.velocities, np.float32)
        wheels = wheels.clip(self._wheels.low, self._wheels.high)
        return {'events': self._events.value(), 'wheels': wheels}


#: Kinds of observations by the name that the environment takes.
OBSERVATIONS: Mapping[str, Callable[[SimulatorParameters], EnvObservation]] = MappingProxyType(
    {
        'state_image': StateImageObservation,
        'spike_counts': SpikeCountsObservation,
        'event_image': EventImageObservation,
        'sensors': SensorsObservation,
    }
)
