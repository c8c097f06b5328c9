"""The parameters of a node that runs somewhere else."""
import time

import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

from ..core.errors import DbscanRegError
from .parameters import NodeParameters

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
    context = Context()
    rclpy.init(args=['dump', *arguments], context=context)
    node = Node('dump', context=context, enable_rosout=False, start_parameter_services=False)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        client = node.create_client(GetParameters, f'{name}/get_parameters')
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            if not client.wait_for_service(min(RETRY, timeout)):
                continue
            future = client.call_async(GetParameters.Request(names=names))
            executor.spin_until_future_complete(future, RETRY)
            if future.done():
                values = [parameter_value_to_python(value) for value in future.result().values]
                break
        else:
            raise RemoteError(f'no answer from the node {name} in {timeout:g} s; is it running, and is the name right?')
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()
    if len(values) != len(names) or None in values:
        raise RemoteError(f'{name} has not the parameters of scan_matcher; give the name of one with --node')
    return NodeParameters().replace(dict(zip(names, values, strict=True)))
