# SPDX-License-Identifier: Apache-2.0
"""Subscriptions that are polled instead of waking the executor."""
from collections.abc import Callable, Iterator
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.subscription import Subscription


def taken(subscription: Subscription) -> Iterator[tuple[Any, dict[str, Any]]]:
    """Yield the messages of a subscription that have arrived and are not handled yet, each with its MessageInfo."""
    with subscription.handle:
        while found := subscription.handle.take_message(subscription.msg_type, False):
            yield found


class WakingCallbackGroup(MutuallyExclusiveCallbackGroup):
    """Callback group whose entities wake the executor only under a condition; otherwise they are polled by `taken`.

    Waking the executor for each message takes far longer than reading the message; the time grows with the number of
    entities that can wake it.

    Parameters
    ----------
    is_active : callable
        Function that returns whether the entities may wake the executor now.
    """

    def __init__(self, is_active: Callable[[], bool]) -> None:
        super().__init__()
        self._is_active = is_active

    def can_execute(self, entity: Any) -> bool:
        """Whether `entity` may be executed now."""
        return self._is_active() and super().can_execute(entity)
