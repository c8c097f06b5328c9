# SPDX-License-Identifier: Apache-2.0
"""Parameters of another running node, set through its parameter services."""
import time
from collections.abc import Mapping, Sequence
from typing import Any

from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter

from ...core.errors import DbscanRegError
from ..own_node import OwnNode


class RemoteError(DbscanRegError):
    """The node does not respond, or refuses a value."""


def write_remote(name: str, values: Mapping[str, Any], timeout: float, arguments: Sequence[str] = ()) -> None:
    """Set parameters, name -> value, of the running node with this full name; if one is refused, none is changed.

    Raises a RemoteError when the node does not respond within `timeout` [s], or refuses a value.
    """
    request = SetParametersAtomically.Request(
        parameters=[Parameter(key, value=value).to_parameter_msg() for key, value in values.items()])
    with OwnNode('parameters', arguments, start_parameter_services=False) as own:
        response = own.ask(SetParametersAtomically, f'{name}/set_parameters_atomically', request,
                           time.monotonic() + timeout)
    if response is None:
        raise RemoteError(f'no answer from the node {name} in {timeout:g} s; is it running, and is the name right?')
    if not response.result.successful:
        raise RemoteError(f'{name} refuses the parameters: {response.result.reason}')
