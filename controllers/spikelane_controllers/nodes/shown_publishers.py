"""Publishes what a controller shows of each step: its state, and what it records on request."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Collection
import functools
from typing import Any, TypeAlias

from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.qos import QoSProfile
from spikelane_msgs.msg import ControllerState, LaneState, Recorded, RecordedQuantity

from spikelane_controllers.quantities import begin_to_record, Quantity, Sample, SpikeTimes
from spikelane_controllers.shown import shown_by
from spikelane_sim import contract, topic_names
from spikelane_sim.contract import Controller
from spikelane_sim.nodes.kept_publisher import KeptPublisher

AnyLaneState: TypeAlias = LaneState | contract.LaneState


class ShownPublishers:
    """The publishers of one controller.

    Attributes:
        publishers: All of them; that of what is recorded is there on request alone.
    """

    def __init__(
        self,
        node: Node,
        name: str,
        driver: Controller,
        record: Collection[str],
        qos: QoSProfile,
        on_match: Callable[[], None],
    ) -> None:
        """Create the publishers, and let the controller record.

        Args:
            node: The node that publishes.
            name: Name of the controller.
            driver: The controller.
            record: Names of the quantities to record; none for no recording.
            qos: Quality of service.
            on_match: As in `KeptPublisher`.

        Raises:
            ParameterError: The controller does not offer a quantity.
        """
        self._driver = driver
        self._quantities = begin_to_record(name, driver, record)
        self._state = ControllerState(controller=name, neurons=list(shown_by(driver).neurons))
        self._recorded = Recorded(controller=name)
        state = KeptPublisher(node, ControllerState, topic_names.CONTROLLER_STATE, qos, on_match)
        self._sent: list[tuple[KeptPublisher, Callable[..., Any]]] = [(state, self._filled_state)]
        if self._quantities:
            recorded = KeptPublisher(node, Recorded, topic_names.RECORDED, qos, on_match)
            self._sent.append((recorded, self._filled_recorded))
        self.publishers = tuple(publisher for publisher, _ in self._sent)

    def send(self, stamp: Time, lane: AnyLaneState | None, *, again: bool = False) -> None:
        """Send what the controller shows of its last step.

        Args:
            stamp: Stamp of the observation that was answered.
            lane: Lane state of that observation.
            again: Send it to those that have missed it.
        """
        for publisher, make in self._sent:
            send = publisher.send_again if again else publisher.send
            send(functools.partial(make, stamp, lane))

    def _filled_state(self, stamp: Time, lane: AnyLaneState | None) -> ControllerState:
        state = self._state
        _begin(state, stamp, lane)
        shown = shown_by(self._driver)
        state.action, state.reward = shown.action, shown.reward
        state.spikes = list(shown.spikes)
        state.learning = getattr(self._driver, 'learning', False)
        return state

    def _filled_recorded(self, stamp: Time, lane: AnyLaneState | None) -> Recorded:
        message = self._recorded
        _begin(message, stamp, lane)
        samples = shown_by(self._driver).recorded
        # A training that repeats an episode to resume has none.
        quantities = [each for each in self._quantities if each.name in samples]
        message.quantities = [_quantity(each, samples[each.name]) for each in quantities]
        return message


def _begin(message: ControllerState | Recorded, stamp: Time, lane: AnyLaneState | None) -> None:
    message.header.stamp = stamp
    if lane is not None:
        message.episode, message.step = lane.episode, lane.step


def _quantity(quantity: Quantity, sample: Sample) -> RecordedQuantity:
    """Return what a quantity was in a step."""
    message = RecordedQuantity(name=quantity.name, unit=quantity.unit)
    message.axes = [axis.name for axis in quantity.axes]
    if isinstance(sample, SpikeTimes):
        message.offsets_ns = array('q', sample.offsets_ns.tolist())
        message.sources = array('I', sample.sources.tolist())
    else:
        message.shape = array('I', sample.shape)
        message.data = array('d', sample.tobytes())
    return message
