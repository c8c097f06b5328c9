"""No events of publishers and subscriptions: each is one more thing that a node looks at for every scan.

What they tell is known without them: the diagnostics look at the quality of service of whoever publishes scans, and who
subscribes to what we publish is told by its own side.
"""
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks

NO_PUBLISHER_EVENTS = PublisherEventCallbacks(use_default_callbacks=False)
NO_SUBSCRIPTION_EVENTS = SubscriptionEventCallbacks(use_default_callbacks=False)
