# SPDX-License-Identifier: Apache-2.0
"""What a node has in the graph, to be taken away as one."""
from rclpy.node import Node

KINDS = {'publishers': 'publisher', 'subscriptions': 'subscription', 'services': 'service', 'timers': 'timer',
         'guards': 'guard_condition'}


class Entities:
    """Everything that is made on a node from now on.

    Parameters
    ----------
    node : rclpy.node.Node
    """

    def __init__(self, node: Node):
        self._node = node
        self._older = self._all()

    def destroy(self):
        """Take it all away."""
        for entity, kind in (self._all().items() - self._older.items()):
            getattr(self._node, f'destroy_{kind}')(entity)

    def _all(self):
        return {entity: kind for plural, kind in KINDS.items() for entity in getattr(self._node, plural)}
