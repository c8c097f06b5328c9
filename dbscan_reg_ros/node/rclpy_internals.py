# SPDX-License-Identifier: Apache-2.0
"""What the node uses of the inside of rclpy to save time, with a plain path where another version has it no more."""
from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import SingleThreadedExecutor, TimeoutException
from rclpy.subscription import Subscription

if TYPE_CHECKING:
    from rclpy.lifecycle import LifecycleNode

IDLE = 1e-3
"""An executor that has waited this long [s] for a callback to execute is idle."""


def _can_take() -> bool:
    try:
        from rclpy.impl.implementation_singleton import rclpy_implementation
    except ImportError:
        return False
    return hasattr(Subscription, 'handle') and hasattr(getattr(rclpy_implementation, 'Subscription', None),
                                                       'take_message')


CAN_TAKE = _can_take()
"""Whether messages can be taken from a subscription without the executor."""
CAN_WAIT = hasattr(SingleThreadedExecutor, 'wait_for_ready_callbacks')
"""Whether an executor can be asked for its next callback, of all entities or of none."""


def _without_events(name: str) -> Any:
    """Event callbacks of a publisher or a subscription that are none.

    Each event handler is one more entity that the executor checks for every scan. Incompatible QoS is reported without
    these events: the diagnostics compare the QoS of our subscriptions with that of the publishers.
    """
    try:
        from rclpy import event_handler
    except ImportError:
        return None
    return getattr(event_handler, name)(use_default_callbacks=False)


NO_PUBLISHER_EVENTS = _without_events('PublisherEventCallbacks')
NO_SUBSCRIPTION_EVENTS = _without_events('SubscriptionEventCallbacks')


def taken(subscription: Subscription) -> Iterator[tuple[Any, dict[str, Any]]]:
    """Yield the messages of a subscription that have arrived and are not handled yet, each with its MessageInfo.

    Without `CAN_TAKE` there are none: the executor passes all to the callback.
    """
    if not CAN_TAKE:
        return
    with subscription.handle:
        while found := subscription.handle.take_message(subscription.msg_type, False):
            yield found


class WakingCallbackGroup(MutuallyExclusiveCallbackGroup):
    """Callback group whose entities wake the executor only while `is_active()`; otherwise they are polled by `taken`.

    Waking the executor for each message takes far longer than reading the message; the time grows with the number of
    entities that can wake it. Without `CAN_TAKE` the entities always wake it.
    """

    def __init__(self, is_active: Callable[[], bool]) -> None:
        super().__init__()
        self._is_active = is_active

    def can_execute(self, entity: Any) -> bool:
        """Whether `entity` may be executed now."""
        return (not CAN_TAKE or self._is_active()) and super().can_execute(entity)


def execute_next(executor: SingleThreadedExecutor) -> None:
    """Wait for the next callback and execute it.

    After each callback rclpy's executor triggers its own guard condition, for other waiting threads, and thus checks
    every entity of the node again. If the executor was idle, this function clears the guard condition without checking
    the entities of the node, in a tenth of the time. Under load it does not clear it, so that every ready entity is
    executed in turn. Without `CAN_WAIT` the executor does as it always does.
    """
    if not CAN_WAIT:
        executor.spin_once()
        return
    began = time.monotonic()
    task, _, _ = executor.wait_for_ready_callbacks()
    idle = time.monotonic() - began > IDLE
    task()
    task.result()
    if idle:
        with contextlib.suppress(TimeoutException):
            executor.wait_for_ready_callbacks(0.0, [])


def answer_impossible_transitions(node: LifecycleNode) -> None:
    """Let a lifecycle node answer a request for a transition that is not possible in its state.

    rclpy raises an error through the executor instead, which ends the node.
    """
    service = getattr(node, '_service_change_state', None)
    if service is None:
        return
    change_state = service.callback

    def on_change_state(request: Any, response: Any) -> Any:
        try:
            return change_state(request, response)
        except RuntimeError as error:
            node.get_logger().error(f'transition {request.transition.id} is not possible now: {error}')
            response.success = False
            return response

    service.callback = on_change_state
