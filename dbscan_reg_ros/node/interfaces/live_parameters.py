# SPDX-License-Identifier: Apache-2.0
"""The node's parameters on the ROS side: declared with descriptors, checked and applied as one."""
import math
from collections.abc import Callable

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

from ...core.errors import ParameterError
from ...core.parameters.schema import Description, suggest
from ...robot.parameters import NodeParameters, is_ros_parameter

INTEGERS = -2**63, 2**63 - 1


class LiveParameters:
    """Keeps `NodeParameters` and the node's ROS parameters the same.

    Parameters
    ----------
    node : rclpy.node.Node
        Made with ``automatically_declare_parameters_from_overrides=True``, so that what a parameter file or the command
        line sets is known.

    Attributes
    ----------
    value : NodeParameters
    changed : callable or None
        Takes the `NodeParameters` and the names of those that were set, each time that some are, be it to what they were; several
        set at once are one change.

    Raises
    ------
    ParameterError
        When a parameter has a wrong value from the start.
    """

    def __init__(self, node: Node):
        self._node = node
        self.changed: Callable | None = None
        self._descriptions = {d.name: d for d in NodeParameters.describe()}
        self.value = NodeParameters().replace(self._given())
        for name, value in self.value.flatten().items():
            value = list(value) if isinstance(value, tuple) else value
            node.declare_parameter(name, value, describe(self._descriptions[name]), ignore_override=True)
        node.add_pre_set_parameters_callback(self._widen)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    def _given(self):
        """Name -> value of the parameters that were set from outside; those nobody knows are reported."""
        given = {}
        for name, parameter in self._node.get_parameters_by_prefix('').items():
            if is_ros_parameter(name):
                continue
            self._node.undeclare_parameter(name)
            if name in self._descriptions:
                given[name] = parameter.value
            else:
                self._node.get_logger().warning(
                    f'unknown parameter {name!r} is ignored; {suggest(name, self._descriptions)}')
        return given

    def _widen(self, parameters):
        """Take whole numbers where numbers are expected: ``ros2 param set ... 5`` means 5.0."""
        unknown = [p.name for p in parameters if not self._node.has_parameter(p.name)]
        if unknown:
            raise ParameterNotDeclaredException(unknown)
        return [self._as_number(parameter) for parameter in parameters]

    def _as_number(self, parameter):
        description = self._descriptions.get(parameter.name)
        if description and description.type is float and parameter.type_ is Parameter.Type.INTEGER:
            return Parameter(parameter.name, value=float(parameter.value))
        if description and description.type is tuple and parameter.type_ is Parameter.Type.INTEGER_ARRAY:
            return Parameter(parameter.name, value=[float(v) for v in parameter.value])
        return parameter

    def _check(self, parameters):
        try:
            self._with(parameters)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply(self, parameters):
        old, self.value = self.value.flatten(), self._with(parameters)
        changes = [f'{name}: {old[name]} -> {value}' for name, value in self.value.flatten().items()
                   if value != old[name]]
        if changes:
            self._node.get_logger().info(f'parameters changed: {", ".join(changes)}')
        if self.changed:
            self.changed(self.value, {parameter.name for parameter in parameters})

    def _with(self, parameters):
        return self.value.replace({p.name: p.value for p in parameters if p.name in self._descriptions})


def describe(description: Description) -> ParameterDescriptor:
    """The ROS descriptor of a parameter."""
    d = description
    unit = f' [{d.unit}]' if d.unit else ''
    descriptor = ParameterDescriptor(description=d.help + unit, read_only=d.read_only,
                                     additional_constraints=d.bounds if d.choices or d.type is tuple else '')
    if d.minimum is None and d.maximum is None:
        return descriptor
    if d.type is float:
        descriptor.floating_point_range = [FloatingPointRange(
            from_value=-math.inf if d.minimum is None else float(d.minimum),
            to_value=math.inf if d.maximum is None else float(d.maximum))]
    elif d.type is int:
        descriptor.integer_range = [IntegerRange(from_value=INTEGERS[0] if d.minimum is None else int(d.minimum),
                                                 to_value=INTEGERS[1] if d.maximum is None else int(d.maximum), step=1)]
    return descriptor
