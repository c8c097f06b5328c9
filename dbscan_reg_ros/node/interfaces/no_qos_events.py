# SPDX-License-Identifier: Apache-2.0
"""No events of publishers and subscriptions: each is one more thing that a node looks at for every scan.

What they would tell is known without them: the diagnostics compare the quality of service of all that we hear with that of
whoever publishes it, and of what we publish the other side tells.
"""
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks

NO_PUBLISHER_EVENTS = PublisherEventCallbacks(use_default_callbacks=False)
NO_SUBSCRIPTION_EVENTS = SubscriptionEventCallbacks(use_default_callbacks=False)
