# SPDX-License-Identifier: Apache-2.0
"""Switch off the QoS events of entities: each event handler is one more entity that the executor checks for every scan.

Incompatible QoS is reported without these events: the diagnostics compare the QoS of our subscriptions with that of the
publishers.
"""
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks

NO_PUBLISHER_EVENTS = PublisherEventCallbacks(use_default_callbacks=False)
NO_SUBSCRIPTION_EVENTS = SubscriptionEventCallbacks(use_default_callbacks=False)
