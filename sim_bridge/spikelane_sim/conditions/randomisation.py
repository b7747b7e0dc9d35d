"""Domain randomisation: each episode's simulator differs from the others by chance.

Tobin et al. 2017 (Domain randomization for transferring deep neural networks from simulation to
the real world): what is learnt where the simulator is never twice the same does not depend on its
being exactly right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spikelane_sim.parameters import parameter, Parameters
from spikelane_sim.random_course import expand_courses

_LEAST_THRESHOLD = 0.01
_DRAWN = 12  # numbers for an episode

#: Places in all ranges that have the smallest and the largest values.
ENDS = ([0.0] * _DRAWN, [1 - 2**-53] * _DRAWN)


@dataclass(frozen=True, kw_only=True)
class RandomisationParameters(Parameters):
    """What each episode draws anew, all of it uniformly; a range of 0 leaves a parameter alone."""

    enabled: bool = parameter(False, 'Draw the parameters below anew in each episode.')
    noise_hz: float = parameter(
        1.0,
        'Noise of each pixel (shot noise with esim) is larger by 0 to this.',
        unit='Hz',
        low=0.0,
        high=100.0,
    )
    threshold: float = parameter(
        0.2,
        'Contrast thresholds are multiplied by 1 - this to 1 + this.',
        low=0.0,
        high=0.9,
    )
    contrast: float = parameter(
        0.5, 'The contrast is multiplied by 1 - this to 1.', low=0.0, high=1.0
    )
    height_m: float = parameter(
        0.02, 'The camera is higher by -this to this.', unit='m', low=0.0, high=1.0
    )
    pitch_deg: float = parameter(
        3.0, 'The camera looks down more by -this to this.', unit='deg', low=0.0, high=45.0
    )
    yaw_deg: float = parameter(
        3.0, 'The camera is turned to the left by -this to this.', unit='deg', low=0.0, high=45.0
    )
    wheels: float = parameter(
        0.05,
        'The radius of each wheel is multiplied by 1 - this to 1 + this.',
        low=0.0,
        high=0.5,
    )
    track: float = parameter(
        0.05,
        'The distance between the wheels is multiplied by 1 - this to 1 + this.',
        low=0.0,
        high=0.5,
    )
    latency_ms: int = parameter(
        100,
        'The latency is longer by 0 to this, in whole steps.',
        unit='ms',
        low=0,
        high=10_000,
    )
    event_loss: float = parameter(
        0.1, 'The share of events that is lost is larger by 0 to this.', low=0.0, high=1.0
    )
    courses: tuple[str, ...] = parameter(
        (),
        'Courses, of which each episode has one: names, paths or random:FIRST-LAST; none: the '
        "simulator's own.",
    )

    @property
    def course_names(self) -> tuple[str, ...]:
        """The courses one by one.

        Raises:
            SpikelaneError: A range of random courses is not one.
        """
        return tuple(each for name in self.courses for each in expand_courses(name))

    def most_added(self, name: str) -> float:
        """Return by how much a parameter can grow, of those that grow by what is drawn."""
        return {
            'pixels.coppelia.noise_rate_hz': self.noise_hz,
            'pixels.esim.shot_rate_hz': self.noise_hz,
            'link.latency_ms': float(self.latency_ms),
            'link.event_loss': self.event_loss,
        }.get(name, 0.0)

    def draw(self, values: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
        """Return the parameters that an episode has in place of the simulator's.

        Args:
            values: The simulator's, under dotted names.
            rng: The episode's; as many numbers are drawn whatever the ranges are.
        """
        return self.chosen(values, rng.random(_DRAWN).tolist())

    def chosen(self, values: Mapping[str, Any], u: Sequence[float]) -> dict[str, Any]:
        """Return the parameters at certain places of their ranges.

        Args:
            values: As in `draw`.
            u: From 0 to less than 1, where each lies in its range, 12 numbers.
        """
        noise_hz = self.noise_hz * u[0]
        around = [2 * each - 1 for each in u]
        threshold = 1 + self.threshold * around[1]
        names = self.course_names
        period_ms = int(values['period_ms'])
        latency_steps = int(u[8] * (self.latency_ms // period_ms + 1))
        on, off = 'pixels.esim.threshold_on', 'pixels.esim.threshold_off'
        noise, shot = 'pixels.coppelia.noise_rate_hz', 'pixels.esim.shot_rate_hz'
        found = {
            noise: values[noise] + noise_hz,
            shot: values[shot] + noise_hz,
            'pixels.coppelia.threshold': values['pixels.coppelia.threshold'] * threshold,
            on: max(values[on] * threshold, _LEAST_THRESHOLD),
            off: max(values[off] * threshold, _LEAST_THRESHOLD),
            'camera.contrast': values['camera.contrast'] * (1 - self.contrast * u[2]),
            'camera.z_m': values['camera.z_m'] + self.height_m * around[3],
            'camera.pitch_deg': values['camera.pitch_deg'] + self.pitch_deg * around[4],
            'camera.yaw_deg': values['camera.yaw_deg'] + self.yaw_deg * around[5],
            'link.latency_ms': values['link.latency_ms'] + latency_steps * period_ms,
            'link.event_loss': min(1.0, values['link.event_loss'] + self.event_loss * u[9]),
        }
        for name, width, share in (
            ('left_wheel_factor', self.wheels, around[6]),
            ('right_wheel_factor', self.wheels, around[7]),
            ('track_factor', self.track, around[10]),
        ):
            found[f'robot.{name}'] = values[f'robot.{name}'] * (1 + width * share)
        if names:
            found['course'] = names[int(u[11] * len(names))]
        return found
