# SPDX-License-Identifier: Apache-2.0
"""Graph entities of a node (publishers, subscriptions, services, timers) that are destroyed together."""
from typing import Any

from rclpy.node import Node

KINDS = {'publishers': 'publisher', 'subscriptions': 'subscription', 'services': 'service', 'timers': 'timer',
         'guards': 'guard_condition'}


class GraphEntities:
    """Publishers, subscriptions, services, timers and guard conditions created on a node after this object."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._before = self._all()

    def destroy(self) -> None:
        """Destroy all entities that were created on the node since the construction of this object."""
        for entity, kind in self._all().items() - self._before.items():
            getattr(self._node, f'destroy_{kind}')(entity)

    def _all(self) -> dict[Any, str]:
        return {entity: kind for plural, kind in KINDS.items() for entity in getattr(self._node, plural)}
