# SPDX-License-Identifier: Apache-2.0
"""Subscriptions that are asked for what has come."""
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup


def taken(subscription):
    """Take the messages that have come and are not handled yet, one after the other."""
    with subscription.handle:
        while message := subscription.handle.take_message(subscription.msg_type, False):
            yield message[0]


class Urgent(MutuallyExclusiveCallbackGroup):
    """Its subscriptions and timers wake the node only while that is urgent; what comes otherwise waits until it is `taken`.

    To be woken for each message costs the node far more than to take it, and each entity that can wake it a little.

    Parameters
    ----------
    is_urgent : callable
    """

    def __init__(self, is_urgent):
        super().__init__()
        self._is_urgent = is_urgent

    def can_execute(self, entity):
        return self._is_urgent() and super().can_execute(entity)
