# SPDX-License-Identifier: Apache-2.0
"""Parameters of another running node, read and set through its parameter services."""
import time
from collections.abc import Mapping, Sequence
from typing import Any

import rclpy
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python

from ...core.errors import DbscanRegError
from ...robot.parameters import NodeParameters
from ...robot.sensors import sensor_descriptions

RETRY = 1.0
"""A service call is repeated after this time [s]: the response is lost until the server has discovered the client."""


class RemoteError(DbscanRegError):
    """The node does not respond, or does not have the parameters of scan_matcher, or refuses a value."""


def read_remote(name: str, timeout: float, arguments: Sequence[str] = ()) -> NodeParameters:
    """Read the parameters of a running node.

    Parameters
    ----------
    name : str
        Name of the node, with its namespace.
    timeout : float
        Time to wait for a response [s].
    arguments : list of str
        ROS arguments.

    Raises
    ------
    RemoteError
        When the node does not respond in time, or is not a scan_matcher.
    """
    known = NodeParameters.describe()
    with _Client(name, timeout, arguments) as client:
        values = client.values([each.name for each in known])
        if own := list(sensor_descriptions(values['sensors'], known)):
            values |= client.values(own)
    return NodeParameters().replace(values)


def write_remote(name: str, values: Mapping[str, Any], timeout: float, arguments: Sequence[str] = ()) -> None:
    """Set parameters of a running node; if one value is refused, none is changed.

    Parameters
    ----------
    name, timeout, arguments
        The same as for `read_remote`.
    values : dict
        Name of each parameter -> value to set.

    Raises
    ------
    RemoteError
        When the node does not respond in time, or refuses a value.
    """
    request = SetParametersAtomically.Request(
        parameters=[Parameter(key, value=value).to_parameter_msg() for key, value in values.items()])
    with _Client(name, timeout, arguments) as client:
        response = client.call(SetParametersAtomically, 'set_parameters_atomically', request)
    if not response.result.successful:
        raise RemoteError(f'{name} refuses the parameters: {response.result.reason}')


class _Client:
    """Client of the services of a node, on a ROS node of its own; use it in a ``with`` statement."""

    def __init__(self, name: str, timeout: float, arguments: Sequence[str]) -> None:
        self._name = name
        self._timeout = timeout
        self._context = Context()
        rclpy.init(args=['parameters', *arguments], context=self._context)
        self._node = Node('parameters', context=self._context, enable_rosout=False, start_parameter_services=False)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)

    def __enter__(self) -> '_Client':
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def values(self, names: Sequence[str]) -> dict[str, Any]:
        """Return name -> value of parameters of the node; raise a RemoteError if it does not have them all."""
        response = self.call(GetParameters, 'get_parameters', GetParameters.Request(names=names))
        values = [parameter_value_to_python(value) for value in response.values]
        if len(values) != len(names) or None in values:
            raise RemoteError(f'{self._name} does not have the parameters of scan_matcher; give the name of a '
                              'scan_matcher node with --node')
        return dict(zip(names, values, strict=True))

    def call(self, kind: type, service: str, request: Any) -> Any:
        """Call a service of the node and return the response."""
        client = self._node.create_client(kind, f'{self._name}/{service}')
        deadline = time.monotonic() + self._timeout
        while time.monotonic() < deadline:
            if not client.wait_for_service(min(RETRY, self._timeout)):
                continue
            future = client.call_async(request)
            self._executor.spin_until_future_complete(future, RETRY)
            if future.done():
                return future.result()
        raise RemoteError(f'no answer from the node {self._name} in {self._timeout:g} s; is it running, and is the '
                          'name right?')
