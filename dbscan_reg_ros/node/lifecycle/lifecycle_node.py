# SPDX-License-Identifier: Apache-2.0
"""The managed node."""
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn

from ...core.errors import ParameterError
from ..interfaces.graph_entities import Entities
from ..interfaces.live_parameters import LiveParameters
from ..node_core import ScanMatcher


class ManagedScanMatcher(LifecycleNode):
    """A `ScanMatcher` that is made when configured, listens while active and is gone after the clean-up."""

    def __init__(self):
        super().__init__('scan_matcher', automatically_declare_parameters_from_overrides=True)
        self._live = LiveParameters(self)
        self._matcher = None
        # rclpy lets the node die of a transition that is not possible from where it is.
        self._ask = self._service_change_state.callback
        self._service_change_state.callback = self._on_change_state

    def _on_change_state(self, request, response):
        try:
            return self._ask(request, response)
        except RuntimeError as error:
            self.get_logger().error(f'transition {request.transition.id} is not possible now: {error}')
            response.success = False
            return response

    def on_configure(self, state):
        entities = Entities(self)
        try:
            self._matcher = ScanMatcher(self, self._live)
        except ParameterError as error:
            entities.destroy()
            return self._refuse(error)
        return super().on_configure(state)

    def on_activate(self, state):
        try:
            self._matcher.activate()
        except ParameterError as error:
            return self._refuse(error)
        return super().on_activate(state)

    def _refuse(self, error):
        self.get_logger().error(str(error))
        return TransitionCallbackReturn.FAILURE

    def on_deactivate(self, state):
        self._matcher.deactivate()
        return super().on_deactivate(state)

    def on_cleanup(self, state):
        self._clean_up()
        return super().on_cleanup(state)

    def on_shutdown(self, state):
        self._clean_up()
        return super().on_shutdown(state)

    def _clean_up(self):
        if self._matcher:
            self._matcher.close()
        self._matcher = None
