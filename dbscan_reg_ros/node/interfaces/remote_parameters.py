# SPDX-License-Identifier: Apache-2.0
"""Parameters of another running node, set through its parameter services."""
import time
from collections.abc import Mapping, Sequence
from typing import Any

import rclpy
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from ...core.errors import DbscanRegError

RETRY = 1.0
"""A service call is repeated after this time [s]: the response is lost until the server has discovered the client."""


class RemoteError(DbscanRegError):
    """The node does not respond, or refuses a value."""


def write_remote(name: str, values: Mapping[str, Any], timeout: float, arguments: Sequence[str] = ()) -> None:
    """Set parameters, name -> value, of the running node with this full name; if one is refused, none is changed.

    Raises a RemoteError when the node does not respond within `timeout` [s], or refuses a value.
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
