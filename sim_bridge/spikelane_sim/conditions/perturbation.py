"""Perturbations: parameters of the simulator that take other values at a moment of the drive."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Any

from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import parameter, Parameters
from spikelane_sim.parsing import parse_yaml, ParseError

#: Parameters that can change while driving; all others are built into course, robot or image.
CHANGEABLE = (
    'markings',
    'camera.x_m',
    'camera.y_m',
    'camera.z_m',
    'camera.pitch_deg',
    'camera.yaw_deg',
    'camera.contrast',
    'pixels.dead_share',
    'pixels.coppelia.noise_rate_hz',
    'pixels.esim.leak_rate_hz',
    'pixels.esim.shot_rate_hz',
    'link.latency_ms',
    'link.event_loss',
    'robot.left_wheel_factor',
    'robot.right_wheel_factor',
    'robot.track_factor',
)


@dataclass(frozen=True, kw_only=True)
class PerturbationParameters(Parameters):
    """What changes while driving, and when; it stays so in all later episodes."""

    changes: tuple[str, ...] = parameter(
        (),
        'Parameters of the simulator with the values that they take, as camera.yaw_deg=5; of '
        f'{", ".join(CHANGEABLE)}.',
    )
    time_s: float = parameter(
        60.0,
        'Time since the beginning of the episode at which they change; it is rounded up to the '
        'end of a step.',
        unit='s',
        low=0.0,
        high=1e7,
    )
    episode: int = parameter(
        1,
        'Number of the episode in which they change; in later ones they have changed from the '
        'beginning.',
        low=1,
        high=2**31 - 1,
    )

    def step(self, period_s: float) -> int:
        """Return the step at whose beginning they change, the episode's first being step 1.

        Args:
            period_s: Length of a step.
        """
        return math.ceil(self.time_s / period_s - 1e-9) + 1

    def values(self) -> dict[str, Any]:
        """Return the changed values under dotted names, as they are in the texts.

        Raises:
            ParameterError: A text cannot be read, or the parameter cannot change.
        """
        found: dict[str, Any] = {}
        for text in self.changes:
            name, equals, value = text.partition('=')
            if not equals or name not in CHANGEABLE:
                raise ParameterError(
                    f'perturbation.changes: expected NAME=VALUE with one of '
                    f'{", ".join(CHANGEABLE)}, got {text!r:.80}'
                )
            if name in found:
                raise ParameterError(f'perturbation.changes: expected {name} once, got it twice')
            found[name] = _value(text, value)
        return found

    def _check_relations(self) -> None:
        self.values()


def _value(text: str, value: str) -> Any:
    try:
        return parse_yaml(value)
    except ParseError as error:
        raise ParameterError(
            f'perturbation.changes: expected a value as in YAML, got {text!r:.80}: {error}'
        ) from None
