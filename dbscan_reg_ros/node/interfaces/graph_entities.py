# SPDX-License-Identifier: Apache-2.0
"""Entities of a node in the ROS graph, destroyed together."""
from typing import Any

from rclpy.node import Node

KINDS = {'publishers': 'publisher', 'subscriptions': 'subscription', 'services': 'service', 'timers': 'timer',
         'guards': 'guard_condition'}


class GraphEntities:
    """Publishers, subscriptions, services, timers and guard conditions created on a node from now on.

    Parameters
    ----------
    node : rclpy.node.Node
        The node that they are created on.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._before = self._all()

    def destroy(self) -> None:
        """Destroy all of them."""
        for entity, kind in self._all().items() - self._before.items():
            getattr(self._node, f'destroy_{kind}')(entity)

    def _all(self) -> dict[Any, str]:
        return {entity: kind for plural, kind in KINDS.items() for entity in getattr(self._node, plural)}
