"""Diagnostics of a controller node, once a second: in its log what is new, and on /diagnostics."""

from __future__ import annotations

from collections.abc import Callable
import time
from typing import NamedTuple

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from spikelane_sim.nodes.base_drive import BaseDrive
from spikelane_sim.nodes.status_publisher import StatusPublisher
from spikelane_sim.nodes.waiting import WaitingWarnings
from spikelane_sim.sensor import Sensor

_PERIOD_S = 1.0
_NOTES_AGAIN = 30  # periods


class Counts(NamedTuple):
    """What a controller node has received and answered."""

    event_packets: int = 0
    lane_states: int = 0
    steps: int = 0


class _Events(NamedTuple):
    """Events at the filters until some time."""

    time_s: float
    came: int
    passed: int


class ControllerDiagnostics:
    """Reports what a controller node receives, and what it waits for."""

    def __init__(
        self,
        node: Node,
        topic: str,
        sensor: Sensor,
        counts: Callable[[], Counts],
        lacks: Callable[[], str],
        base: BaseDrive | None = None,
    ) -> None:
        """Begin to report, by steady time: that of a simulator may stand still.

        Args:
            node: The controller node.
            topic: Topic of the event packets, as the log calls it.
            sensor: Counts what is wrong with the packets.
            counts: Returns what was received and answered.
            lacks: Returns what the node waits for.
            base: Drives the robot's base; None where the node drives none.
        """
        self._node, self._topic, self._sensor = node, topic, sensor
        self._counts, self._lacks, self._base = counts, lacks, base
        self._said: dict[str, tuple[str, int]] = {}  # notes of the sensor, and when [periods]
        self._periods = 0
        self._faults: dict[str, int] = {}  # at the last message
        self._events = _Events(time.monotonic(), 0, 0)  # likewise
        self._status = StatusPublisher(node, node.get_name())
        self._waiting = WaitingWarnings(node, lambda: counts().steps, lacks)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(_PERIOD_S, self._report, clock=steady)

    def _report(self) -> None:
        self._report_notes()
        self._publish()

    def _report_notes(self) -> None:
        """Warn of what is odd in the packets: at once, then of a kind once in a while."""
        self._periods += 1
        for kind, text in self._sensor.notes.items():
            said, when = self._said.get(kind, ('', -_NOTES_AGAIN))
            # Faults are reported as they come.
            if text != said and self._periods - when >= _NOTES_AGAIN and 'faulty' not in kind:
                self._said[kind] = (text, self._periods)
                self._node.get_logger().warning(f'{self._topic}: {text}')

    def _publish(self) -> None:
        """Publish all counts; the level is WARN while a step is lacking or packets are faulty."""
        before, self._faults = self._faults, self._count_faults()
        has_new_faults = any(self._faults[name] > before.get(name, 0) for name in self._faults)
        is_waiting = self._waiting.is_due
        text = self._lacks() if is_waiting else 'answering'
        stopped = '' if self._base is None else self._base.lacks()
        self._status.publish(
            '; '.join(filter(None, (text, stopped))),
            {
                **self._counts()._asdict(),
                'waiting_s': self._waiting.idle_s,
                **self._event_counts(),
                'source': {None: '', True: 'camera', False: 'simulator'}[self._sensor.is_camera],
                **self._faults,
                **self._base_values(),
            },
            is_worrying=is_waiting or has_new_faults or bool(stopped),
        )

    def _base_values(self) -> dict[str, object]:
        """Return what the base was told, under names that say so."""
        values = {} if self._base is None else self._base.values()
        return {f'base_{name}': value for name, value in values.items()}

    def _event_counts(self) -> dict[str, float]:
        """Return how many events came to the filters and passed, and how many a second lately."""
        sensor, before = self._sensor, self._events
        self._events = now = _Events(time.monotonic(), sensor.events_in, sensor.events_out)
        seconds = max(now.time_s - before.time_s, 1e-9)
        return {
            'events_in': now.came,
            'events_out': now.passed,
            'events_in_per_s': round((now.came - before.came) / seconds, 1),
            'events_out_per_s': round((now.passed - before.passed) / seconds, 1),
        }

    def _count_faults(self) -> dict[str, int]:
        sensor = self._sensor
        return {
            'faulty_packets': sensor.faulty,
            'lost_packets': sensor.lost,
            'reserved_words': sensor.reserved,
            'events_outside': sensor.outside,
            'events_mistimed': sensor.mistimed,
            'restarts': sensor.restarts,
        }
