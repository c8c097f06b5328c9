# SPDX-License-Identifier: Apache-2.0
"""Lifecycle node of ``scan_matcher_lifecycle``."""
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from ...core.errors import ParameterError
from ..interfaces.endpoints import GraphEntities
from ..interfaces.live_parameters import LiveParameters
from ..node_core import NodeCore
from ..rclpy_internals import answer_impossible_transitions


class ScanMatcherLifecycleNode(LifecycleNode):
    """Lifecycle node: `NodeCore` is created on configure, subscribed to scans while active, destroyed on cleanup."""

    def __init__(self) -> None:
        super().__init__('scan_matcher', automatically_declare_parameters_from_overrides=True)
        self._live = LiveParameters(self)
        self._core: NodeCore | None = None
        answer_impossible_transitions(self)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Create the publishers, services and timers of the node."""
        entities = GraphEntities(self)
        try:
            self._core = NodeCore(self, self._live)
        except ParameterError as error:
            entities.destroy()
            return self._fail(error)
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Subscribe to the scans."""
        try:
            if self._core:
                self._core.activate()
        except ParameterError as error:
            return self._fail(error)
        return super().on_activate(state)

    def _fail(self, error: ParameterError) -> TransitionCallbackReturn:
        self.get_logger().error(str(error))
        return TransitionCallbackReturn.FAILURE

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Unsubscribe from the scans; the pose is kept."""
        if self._core:
            self._core.deactivate()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Destroy the publishers, subscriptions, services and timers; keep the parameters."""
        self._close_core()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Destroy the publishers, subscriptions, services and timers; keep the parameters."""
        self._close_core()
        return super().on_shutdown(state)

    def _close_core(self) -> None:
        if self._core:
            self._core.close()
        self._core = None
