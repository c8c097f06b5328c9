"""A peer of the node under test: publishes, listens, calls services, and waits with a deadline."""
import contextlib
import threading
import time

import rclpy
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters, SetParametersAtomically
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python

TIMEOUT = 20.0


class Peer:
    """A ROS node of the test's own, in its own context; use it in a ``with`` statement."""

    def __init__(self, name='peer'):
        self._context = Context()
        rclpy.init(context=self._context)
        self.node = Node(name, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()

    def until(self, condition, timeout=TIMEOUT):
        """Spin until `condition` gives something true, and return that."""
        deadline = time.monotonic() + timeout
        while not (result := condition()):
            assert time.monotonic() < deadline, 'the condition did not become true in time'
            self._executor.spin_once(0.05)
        return result

    @contextlib.contextmanager
    def spinning(self):
        """Spin in a thread of its own while the ``with`` statement lasts."""
        ended = threading.Event()

        def spin():
            while not ended.is_set():
                self._executor.spin_once(0.02)

        thread = threading.Thread(target=spin)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()

    def listen(self, kind, topic, quality=100):
        """A list that takes what is published on `topic`; there is a publisher that knows of it."""
        messages = []
        self.node.create_subscription(kind, topic, messages.append, quality)
        self.until(lambda: self.node.count_publishers(topic))
        return messages

    def call(self, kind, service, request):
        """The response of a service; repeated, for it is lost while the other side does not know the caller yet."""
        client = self.node.create_client(kind, service)
        self.until(client.service_is_ready)
        deadline = time.monotonic() + TIMEOUT
        while time.monotonic() < deadline:
            future = client.call_async(request)
            self._executor.spin_until_future_complete(future, 1.0)
            if future.done():
                self.node.destroy_client(client)
                return future.result()
        raise AssertionError(f'{service} does not answer')


class Parameters:
    """The parameters of a running node, through its services, as ``ros2 param`` sees them."""

    def __init__(self, peer, node='/scan_matcher'):
        self._peer = peer
        self._node = node

    def names(self):
        return self._peer.call(ListParameters, f'{self._node}/list_parameters', ListParameters.Request()).result.names

    def describe(self, *names):
        request = DescribeParameters.Request(names=names)
        return self._peer.call(DescribeParameters, f'{self._node}/describe_parameters', request).descriptors

    def get(self, *names):
        request = GetParameters.Request(names=names)
        values = self._peer.call(GetParameters, f'{self._node}/get_parameters', request).values
        return [parameter_value_to_python(value) for value in values]

    def set(self, **values):
        """One result for each, set one by one; two underlines in a name stand for the dot."""
        request = SetParameters.Request(parameters=_messages(values))
        return self._peer.call(SetParameters, f'{self._node}/set_parameters', request).results

    def set_together(self, **values):
        """The one result of setting all or none."""
        request = SetParametersAtomically.Request(parameters=_messages(values))
        return self._peer.call(SetParametersAtomically, f'{self._node}/set_parameters_atomically', request).result


def _messages(values) -> list[ParameterMessage]:
    return [Parameter(name.replace('__', '.'), value=value).to_parameter_msg() for name, value in values.items()]
