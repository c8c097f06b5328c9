# SPDX-License-Identifier: Apache-2.0
"""The parameters of a node that runs somewhere else."""
import time

import rclpy
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python

from ...core.errors import DbscanRegError
from ...robot.parameters import NodeParameters

RETRY = 1.0
"""A call is repeated after this time [s]: the answer is lost while the other side does not know the caller yet."""


class RemoteError(DbscanRegError):
    """The node is not there, or has other parameters."""


def read_remote(name, timeout, arguments=()) -> NodeParameters:
    """The parameters of the running node called `name`.

    Parameters
    ----------
    name : str
        Full name.
    timeout : float
        [s]
    arguments : list of str
        ROS arguments.

    Raises
    ------
    RemoteError
        When it does not answer in time, or is no scan_matcher.
    """
    names = [description.name for description in NodeParameters.describe()]
    answer = _call(name, GetParameters, 'get_parameters', GetParameters.Request(names=names), timeout, arguments)
    values = [parameter_value_to_python(value) for value in answer.values]
    if len(values) != len(names) or None in values:
        raise RemoteError(f'{name} has not the parameters of scan_matcher; give the name of one with --node')
    return NodeParameters().replace(dict(zip(names, values, strict=True)))


def write_remote(name, values, timeout, arguments=()):
    """Set parameters of a running node, all or none; arguments and errors are those of `read_remote`.

    Parameters
    ----------
    values : dict
        Name -> value.

    Raises
    ------
    RemoteError
        Also when it refuses a value.
    """
    request = SetParametersAtomically.Request(
        parameters=[Parameter(key, value=value).to_parameter_msg() for key, value in values.items()])
    answer = _call(name, SetParametersAtomically, 'set_parameters_atomically', request, timeout, arguments)
    if not answer.result.successful:
        raise RemoteError(f'{name} refuses the parameters: {answer.result.reason}')


def _call(name, kind, service, request, timeout, arguments):
    """The answer of a service of the node called `name`."""
    context = Context()
    rclpy.init(args=['parameters', *arguments], context=context)
    node = Node('parameters', context=context, enable_rosout=False, start_parameter_services=False)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        client = node.create_client(kind, f'{name}/{service}')
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            if not client.wait_for_service(min(RETRY, timeout)):
                continue
            future = client.call_async(request)
            executor.spin_until_future_complete(future, RETRY)
            if future.done():
                return future.result()
        raise RemoteError(f'no answer from the node {name} in {timeout:g} s; is it running, and is the name right?')
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()
