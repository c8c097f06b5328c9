# SPDX-License-Identifier: Apache-2.0
"""ROS parameters of the node: declared with descriptors, checked and applied together."""
import math
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

from ...core.errors import ParameterError
from ...core.parameters.schema import Description, gone, suggest
from ...robot.parameters import NodeParameters, is_ros_parameter
from ...robot.sensors import sensor_descriptions

INTEGERS = -2**63, 2**63 - 1
"""Smallest and largest integer value of a ROS parameter."""


class LiveParameters:
    """Keeps `NodeParameters` equal to the ROS parameters of a node.

    The node is created with ``automatically_declare_parameters_from_overrides=True``, so that the values of parameter
    files and of the command line are known; an invalid one raises a ParameterError.

    Attributes
    ----------
    value : NodeParameters
        The current values.
    changed : callable or None
        Called after each change, with the `NodeParameters` and the names of the parameters that were set, even to their
        old values; parameters set together are one change.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.changed: Callable[[NodeParameters, set[str]], None] | None = None
        given = self._given()
        known = NodeParameters.describe()
        self._descriptions = {d.name: d for d in known} | sensor_descriptions(given.get('sensors'), known)
        for name in sorted(given.keys() - self._descriptions.keys()):
            if gone(name, self._descriptions):
                raise ParameterError(gone(name, self._descriptions))
            del given[name]
            node.get_logger().warning(f'unknown parameter {name!r} is ignored; {suggest(name, self._descriptions)}')
        self.value = NodeParameters().replace(given)
        for name, value in self.value.flatten().items():
            declared = list(value) if isinstance(value, tuple) else value
            node.declare_parameter(name, declared, describe(self._descriptions[name]), ignore_override=True)
        node.add_pre_set_parameters_callback(self._convert)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    def _given(self) -> dict[str, Any]:
        """Return name -> value of the parameters set in files and on the command line, without those of every node."""
        given = {}
        for name, parameter in self._node.get_parameters_by_prefix('').items():
            if is_ros_parameter(name):
                continue
            self._node.undeclare_parameter(name)
            given[name] = parameter.value
        return given

    def _convert(self, parameters: list[Parameter]) -> list[Parameter]:
        """Accept integers for floats: ``ros2 param set ... 5`` means 5.0."""
        unknown = [p.name for p in parameters if not self._node.has_parameter(p.name)]
        if unknown:
            raise ParameterNotDeclaredException(unknown)
        return [self._as_float(parameter) for parameter in parameters]

    def _as_float(self, parameter: Parameter) -> Parameter:
        description = self._descriptions.get(parameter.name)
        if description and description.type is float and parameter.type_ is Parameter.Type.INTEGER:
            return Parameter(parameter.name, value=float(parameter.value))
        if description and description.type is tuple and parameter.type_ is Parameter.Type.INTEGER_ARRAY:
            return Parameter(parameter.name, value=[float(v) for v in parameter.value])
        return parameter

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            self._with(parameters)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply(self, parameters: list[Parameter]) -> None:
        old, self.value = self.value.flatten(), self._with(parameters)
        changes = [f'{name}: {old[name]} -> {value}' for name, value in self.value.flatten().items()
                   if value != old[name]]
        if changes:
            self._node.get_logger().info(f'parameters changed: {", ".join(changes)}')
        if self.changed:
            self.changed(self.value, {parameter.name for parameter in parameters})

    def _with(self, parameters: list[Parameter]) -> NodeParameters:
        own = {p.name: p.value for p in parameters if p.name in self._descriptions}
        return self.value.replace(own) if own else self.value


def describe(description: Description) -> ParameterDescriptor:
    """Make the ROS descriptor of a parameter."""
    d = description
    unit = f' [{d.unit}]' if d.unit else ''
    descriptor = ParameterDescriptor(description=d.help + unit, read_only=d.read_only,
                                     additional_constraints=d.bounds if d.choices or d.type is tuple else '')
    if d.minimum is None and d.maximum is None:
        return descriptor
    if d.type is float:
        low, high = _limits(d, (-math.inf, math.inf))
        descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]
    elif d.type is int:
        low, high = _limits(d, INTEGERS)
        descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    return descriptor


def _limits(description: Description, unbounded: tuple[float, float]) -> tuple[float, float]:
    """Return minimum and maximum of a parameter; a missing bound is replaced by that of `unbounded`."""
    low, high = description.minimum, description.maximum
    return unbounded[0] if low is None else low, unbounded[1] if high is None else high
