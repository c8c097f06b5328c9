# SPDX-License-Identifier: Apache-2.0
"""ROS node of a command, which talks to a running node."""
import time
from collections.abc import Sequence
from typing import Any, TypeVar

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

POLL = 0.02
"""Interval [s] at which the ROS graph is checked."""
RETRY = 1.0
"""A service call is repeated after this time [s]: the response is lost until the server has discovered the client."""


Own = TypeVar('Own', bound='OwnNode')


class OwnNode:
    """A ROS node with a context and an executor of its own; use it in a ``with`` statement.

    `arguments` are ROS arguments, for example ``['--ros-args', '-r', 'scan:=laser']``; `options` those of `Node`.
    """

    def __init__(self, name: str, arguments: Sequence[str] = (), **options: Any) -> None:
        self._context = Context()
        rclpy.init(args=[name, *arguments], context=self._context)
        self._node = Node(name, context=self._context, enable_rosout=False, **options)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)

    def __enter__(self: Own) -> Own:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Destroy the node."""
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def ask(self, kind: type, service: str, request: Any, deadline: float) -> Any:
        """Return the response of a service; None if there is none at the `deadline` [s] of the steady clock."""
        client = self._node.create_client(kind, service)
        try:
            while time.monotonic() < deadline:
                if not client.service_is_ready():
                    self._executor.spin_once(POLL)
                    continue
                future = client.call_async(request)
                self._executor.spin_until_future_complete(future, RETRY)
                if future.done():
                    return future.result()
        finally:
            self._node.destroy_client(client)
        return None
