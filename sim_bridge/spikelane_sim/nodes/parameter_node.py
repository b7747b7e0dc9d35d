"""The base of all nodes: it says why a parameter cannot be set, and lets those change that may.

The middleware refuses a read-only parameter, and a value out of range, with words of its own, and
asks the node only afterwards. Here a value is checked with the rules and the message of the start
(`ros2 param set` prints the reason), and a change takes effect when its declaration says so.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from rcl_interfaces.msg import ParameterEvent, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile

from spikelane_sim.errors import ParameterError
from spikelane_sim.nodes import conversions
from spikelane_sim.nodes.kept_publisher import KeptPublisher
from spikelane_sim.parameter_changes import ChangingParameters, fixed_reason, ParameterChange
from spikelane_sim.parameters import ParameterSpec

_KEPT = QoSProfile(depth=1000)


class ParameterNode(Node):
    """A node with parameters of the core's classes; all are fixed, unless `let_change` is used."""

    _changing: tuple[ChangingParameters[Any], ...] = ()

    def let_change(self, *changing: ChangingParameters[Any]) -> None:
        """Let parameters be set while the node runs.

        Args:
            changing: Those in use. They must have been declared as such
                (`ros_parameters.declare_parameters`).
        """
        self._changing += changing

    def set_parameters(self, parameter_list: list[Parameter]) -> list[SetParametersResult]:
        """Set parameters one by one; see `set_parameters_atomically`."""
        return [self.set_parameters_atomically([each]) for each in parameter_list]

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set all parameters or none; the result says why not, or when they take effect."""
        try:
            self._check(parameter_list)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        result = super().set_parameters_atomically(parameter_list)
        if result.successful:
            moments = []
            for changing in self._changing:
                values = _values_of(changing, parameter_list)
                changing.change(values)
                moments += [
                    f'{name} from the {changing.specs[name].changes} on' for name in values
                ]
            result.reason = ', '.join(moments)
        return result

    def _check(self, parameters: Sequence[Parameter]) -> None:
        changeable: dict[str, ParameterSpec] = {}
        for changing in self._changing:
            changeable |= changing.specs
        for each in parameters:
            if not self.has_parameter(each.name):
                raise ParameterError(
                    f'{each.name}: expected a parameter of {self.get_fully_qualified_name()}'
                )
            if self.describe_parameter(each.name).read_only:
                raise ParameterError(fixed_reason(each.name, changeable))
        for changing in self._changing:
            changing.check(_values_of(changing, parameters))


def _values_of(
    changing: ChangingParameters[Any], parameters: Iterable[Parameter]
) -> dict[str, Any]:
    return {each.name: each.value for each in parameters if each.name in changing.specs}


class ChangePublisher:
    """Publishes each change of a node's parameters with the first observation that it holds for.

    Attributes:
        publisher: Publishes `rcl_interfaces/ParameterEvent`, whose stamp is that of the
            observation.
    """

    def __init__(self, node: Node, topic: str, *changing: ChangingParameters[Any]) -> None:
        """Create the publisher.

        Args:
            node: The node that has the parameters.
            topic: Where to publish.
            changing: The parameters.
        """
        self.publisher = KeptPublisher(node, ParameterEvent, topic, _KEPT)
        self._node_name = node.get_fully_qualified_name()
        self._changing = changing
        self._sent = [0] * len(changing)

    def publish(self) -> None:
        """Publish what has taken effect since the last time."""
        for index, changing in enumerate(self._changing):
            new = changing.log[self._sent[index] :]
            self._sent[index] += len(new)
            for change in new:
                self.publisher.publish(self._message(change))

    def _message(self, change: ParameterChange) -> ParameterEvent:
        changed = [
            Parameter(name, value=value).to_parameter_msg()
            for name, value in change.values.items()
        ]
        stamp = conversions.to_time(change.stamp_ns)
        return ParameterEvent(stamp=stamp, node=self._node_name, changed_parameters=changed)
