# SPDX-License-Identifier: Apache-2.0
"""Publishers and subscriptions without QoS events, whose QoS can be overridden, and all entities of a node.

The ROS parameters are ``qos_overrides.TOPIC.publisher.POLICY`` and ``qos_overrides.TOPIC.subscription.POLICY``, where
TOPIC is the resolved name of the topic.
"""
import copy
import warnings
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from rclpy.subscription import Subscription

from ...core.errors import ParameterError
from ..rclpy_internals import NO_PUBLISHER_EVENTS, NO_SUBSCRIPTION_EVENTS
from .topics import Topic

POLICIES = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY)


def publisher(node: Node, topic: Topic) -> Publisher:
    """Create a publisher, whose quality of service may be overridden.

    Raises a ParameterError when a parameter that overrides the quality of service has an invalid value.
    """
    return _made(node, topic, 'publisher', lambda options: node.create_publisher(
        topic.kind, topic.name, copy.copy(topic.quality), event_callbacks=NO_PUBLISHER_EVENTS,
        qos_overriding_options=options))


def subscription(node: Node, topic: Topic, callback: Callable[..., None]) -> Subscription:
    """Create a subscription; parameters and errors are the same as for the function `publisher`."""
    return _made(node, topic, 'subscription', lambda options: node.create_subscription(
        topic.kind, topic.name, callback, copy.copy(topic.quality), event_callbacks=NO_SUBSCRIPTION_EVENTS,
        qos_overriding_options=options))


def _made(node: Node, topic: Topic, entity: str, make: Callable[[QoSOverridingOptions], Any]) -> Any:
    """Create a publisher or subscription with QoS overrides; raise a ParameterError that names invalid overrides."""
    name = f'qos_overrides.{node.resolve_topic_name(topic.name)}.{entity}'
    given = {key: p.value for key, p in node.get_parameters_by_prefix(name).items()}
    try:
        with warnings.catch_warnings():
            # rclpy warns of a depth of 0, which `_is_valid` refuses.
            warnings.filterwarnings('ignore', 'A zero depth', UserWarning)
            return make(QoSOverridingOptions(POLICIES, callback=_is_valid))
    except (RuntimeError, AssertionError, AttributeError, InvalidQosOverridesError):
        if not given:
            raise
        raise ParameterError(f'{name} = {given}: expected reliability best_effort or reliable, durability volatile or '
                             'transient_local, history keep_last or keep_all, and a depth of at least 1') from None


def _is_valid(quality: QoSProfile) -> SetParametersResult:
    least = 0 if quality.history == HistoryPolicy.KEEP_ALL else 1
    unknown = (ReliabilityPolicy.UNKNOWN, HistoryPolicy.UNKNOWN, DurabilityPolicy.UNKNOWN)
    return SetParametersResult(successful=quality.depth >= least and not any(
        policy in unknown for policy in (quality.reliability, quality.history, quality.durability)))


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
