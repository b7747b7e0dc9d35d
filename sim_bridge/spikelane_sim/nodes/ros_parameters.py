"""ROS parameters made from the core's parameter classes."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import Parameters, ParameterSpec

ParametersT = TypeVar('ParametersT', bound=Parameters)

_INTEGER_MAX = 2**63 - 1


def declare_parameters(
    node: Node, parameters: type[ParametersT], *, may_change: bool = False
) -> ParametersT:
    """Declare all of a class's parameters on a node and return their values.

    A parameter that was given under a former name is declared under both.

    Args:
        node: The node.
        parameters: The class.
        may_change: Whether those parameters that may be changed can be set while the node runs:
            what `ParameterNode.let_change` is for. All others are fixed.

    Raises:
        ParameterError: A value given to the node is not allowed.
    """
    specs = tuple(parameters.specs())
    names = [spec.name for spec in parameters.accepted_specs()]
    given = {name: value for name in names if (value := given_value(node, name)) is not None}
    meant = parameters.current(given)
    meant = {**parameters.chosen_defaults(meant), **meant}
    meant = {name: value for name, value in meant.items() if given.get(name) != value}
    if not may_change:
        specs = tuple(dataclasses.replace(spec, changes='') for spec in specs)
    values = {spec.name: declare_parameter(node, spec, meant.get(spec.name)) for spec in specs}
    for name in set(given) - set(values):
        node.declare_parameter(name, given[name], ParameterDescriptor(read_only=True))
    return parameters.from_mapping(values)


def given_value(node: Node, name: str) -> Any:
    """Return what a node was given for a parameter, None for nothing."""
    if node.has_parameter(name):
        return node.get_parameter(name).value
    value = node.declare_parameter(name, None, ParameterDescriptor(dynamic_typing=True)).value
    node.undeclare_parameter(name)
    return value


def declare_parameter(node: Node, spec: ParameterSpec, value: Any = None) -> Any:
    """Declare one parameter, unless it has been declared, and return its value.

    Args:
        node: The node.
        spec: The parameter.
        value: The value, whatever the node was given; None for what it was given, or the default.

    Raises:
        ParameterError: The value given to the node is not allowed.
    """
    if node.has_parameter(spec.name):
        return _checked(spec, node.get_parameter(spec.name).value)
    default = list(spec.default) if spec.kind is tuple else spec.default
    wanted = default if value is None else value
    try:
        # As rclpy has it, what the node was given comes before what is declared.
        parameter = node.declare_parameter(spec.name, wanted, _descriptor(spec), value is not None)
    except Exception as error:  # rclpy has no common base for what declaring can raise
        if not node.context.ok():  # a signal has ended the start: the parameter is not wrong
            raise
        raise ParameterError(f'{spec.name}: expected {spec.allowed}; {error}') from None
    return _checked(spec, parameter.value)


def _checked(spec: ParameterSpec, value: Any) -> Any:
    # An empty list in a file has no type, and the middleware takes it for no value.
    return spec.check(() if value is None and spec.kind is tuple else value)


def _descriptor(spec: ParameterSpec) -> ParameterDescriptor:
    """Describe a parameter; dynamic typing lets 100 be given where 100.0 is meant."""
    unit = f' [{spec.unit}]' if spec.unit else ''
    source = f' Source: {spec.source}.' if spec.source else ''
    changes = f' Can be changed while the node runs: from the {spec.changes} on.'
    descriptor = ParameterDescriptor(
        description=f'{spec.description}{unit}{source}{changes if spec.changes else ""}',
        additional_constraints=spec.allowed,
        read_only=not spec.changes,
        dynamic_typing=True,
    )
    if spec.low is None and spec.high is None:
        return descriptor
    if spec.kind is int:
        low = -_INTEGER_MAX if spec.low is None else int(spec.low)
        high = _INTEGER_MAX if spec.high is None else int(spec.high)
        descriptor.integer_range = [IntegerRange(from_value=low, to_value=high, step=0)]
    elif spec.kind is float:
        low_value = float('-inf') if spec.low is None else float(spec.low)
        high_value = float('inf') if spec.high is None else float(spec.high)
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=low_value, to_value=high_value, step=0.0)
        ]
    return descriptor
