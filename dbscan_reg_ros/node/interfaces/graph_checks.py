# SPDX-License-Identifier: Apache-2.0
"""Checks of the ROS graph: incompatible publishers, and publishers that share a topic with ours."""
from collections import deque
from collections.abc import Iterable

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSCompatibility, QoSProfile, ReliabilityPolicy, qos_check_compatible
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

UNKNOWN = '_NODE_NAME_UNKNOWN_'
"""Node name that rmw gives to an endpoint whose node is not discovered yet."""
RECENT = 20
"""Number of the latest scans among which changes of the publisher are counted."""
UNNAMED = 'an unnamed node'
POLICIES = {'reliability': (ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT),
            'durability': (DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE)}
"""QoS policy -> value that a subscription may request, and the offered value that does not satisfy the request."""


def full_name(endpoint: TopicEndpointInfo) -> str:
    """Name of the node of an endpoint, with its namespace; `UNNAMED` while the node is not discovered."""
    if endpoint.node_name == UNKNOWN:
        return UNNAMED
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'


def named(endpoints: Iterable[TopicEndpointInfo]) -> str:
    """Names of the nodes of `endpoints` without repetitions, separated by commas; empty if there are no endpoints."""
    return ', '.join(sorted({full_name(endpoint) for endpoint in endpoints}))


def publishers(node: Node, topic: str) -> dict[bytes, TopicEndpointInfo]:
    """Return gid -> endpoint information of all publishers on `topic`."""
    return {bytes(endpoint.endpoint_gid): endpoint for endpoint in node.get_publishers_info_by_topic(topic)}


def other_publishers(node: Node, topic: str) -> list[TopicEndpointInfo]:
    """Return the endpoint information of all publishers on `topic` except one publisher of `node`."""
    endpoints = node.get_publishers_info_by_topic(topic)
    own = node.get_fully_qualified_name()
    ours = next((endpoint for endpoint in endpoints if full_name(endpoint) == own), None)
    return [endpoint for endpoint in endpoints if endpoint is not ours]


def incompatibilities(node: Node, subscription: Subscription) -> list[str]:
    """Return a sentence for each publisher that is incompatible with a subscription of `node`, with the reason."""
    endpoints = node.get_publishers_info_by_topic(subscription.topic_name)
    return list(filter(None, (_incompatibility(node, subscription, endpoint) for endpoint in endpoints)))


def _incompatibility(node: Node, subscription: Subscription, endpoint: TopicEndpointInfo) -> str:
    """Describe why the type or QoS of a publisher is incompatible with a subscription; empty if it is compatible."""
    topic, name = subscription.topic_name, full_name(endpoint)
    kind = subscription.msg_type
    expected = f'{kind.__module__.partition(".")[0]}/msg/{kind.__name__}'
    if endpoint.topic_type != expected:
        return f'{name} publishes {endpoint.topic_type} on {topic}; expected {expected}: its messages are not received'
    verdict, reason = qos_check_compatible(endpoint.qos_profile, subscription.qos_profile)
    if verdict != QoSCompatibility.ERROR:
        return ''
    difference = _difference(node, topic, endpoint.qos_profile, subscription.qos_profile)
    return (f'the quality of service of {name} on {topic} is incompatible with ours, its messages are not received: '
            f'{difference or reason.strip() or "incompatible"}')


def _difference(node: Node, topic: str, offered: QoSProfile, requested: QoSProfile) -> str:
    """Describe the QoS policies in which a publisher offers less than we request, and the remedies."""
    differences, remedies = [], ['let it publish with ours']
    for policy, (more, less) in POLICIES.items():
        if getattr(requested, policy) == more and getattr(offered, policy) == less:
            differences.append(f'its {policy} is {_words(less)}, ours {_words(more)}')
            override = f'qos_overrides.{topic}.subscription.{policy}'
            if node.has_parameter(override):
                remedies.append(f'start this node with {override}:={less.short_key}')
    return f'{", ".join(differences)}; {", or ".join(remedies)}' if differences else ''


def _words(policy: ReliabilityPolicy | DurabilityPolicy) -> str:
    return str(policy.short_key).replace('_', ' ')


class Competition:
    """Finds out whether several publishers send the scans of one lidar, from the numbers of the messages on a `topic`.

    Each publisher counts its messages. A number that is not above the last one means another publisher, or one that was
    started again.
    """

    def __init__(self, node: Node, topic: str) -> None:
        self._node, self._topic, self._text = node, topic, ''
        self._last: int | None = 0
        self._changes: deque[bool] = deque(maxlen=RECENT)

    def add(self, number: int | None) -> None:
        """Add the number of the next message; None if the middleware has none."""
        self._changes.append(number is None or self._last is None or number <= self._last)
        self._last = number
        if not any(self._changes):
            self._text = ''

    def found(self, changes: int = 1) -> str:
        """Return a warning with a remedy, if there are several publishers that changed as often; else empty."""
        if sum(self._changes) < changes:
            return ''
        names = sorted(map(full_name, self._node.get_publishers_info_by_topic(self._topic)))
        # Publishers whose scans still wait may have gone.
        if names[1:]:
            self._text = (f'{self._topic} has {len(names)} publishers whose scans have the same frame, '
                          f'{", ".join(names)}: expected one for each lidar; stop the others, or give each lidar a '
                          'topic of its own, and name the topics in scan_topics')
        return self._text


def is_scan_matcher(node: Node, endpoint: TopicEndpointInfo) -> bool:
    """Whether the node of an endpoint is one of this package: it has the service ``~/snapshot``."""
    try:
        services = node.get_service_names_and_types_by_node(endpoint.node_name, endpoint.node_namespace)
    except RuntimeError:
        return False
    return any(name == f'{full_name(endpoint)}/snapshot' for name, _ in services)


def shared(node: Node, publisher: Publisher) -> str:
    """Warning that other nodes publish on the topic of our `publisher`, with a remedy; empty if no other node does."""
    names = named(other_publishers(node, publisher.topic_name))
    if not names:
        return ''
    own = node.get_fully_qualified_name()
    names = ', '.join(f'another node named {name}' if name == own else name for name in names.split(', '))
    return (f'{publisher.topic_name} is also published by {names}: subscribers receive two odometries mixed; remap '
            'ours, as with --ros-args -r odom:=laser_odom, or theirs')
