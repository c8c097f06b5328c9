# SPDX-License-Identifier: Apache-2.0
"""Who else is in the ROS graph, in words, and what of theirs never gets here or gets in our way."""
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSCompatibility, ReliabilityPolicy, qos_check_compatible

UNKNOWN = '_NODE_NAME_UNKNOWN_'
"""rmw's name for the node of an endpoint that is known, while the node is not."""
SOMEBODY = 'somebody'
POLICIES = {'reliability': (ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT),
            'durability': (DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE)}
"""What a subscription may ask for, and what is less than that."""


def full_name(endpoint) -> str:
    """The name of the node that an endpoint belongs to; `SOMEBODY` while that is not discovered."""
    if endpoint.node_name == UNKNOWN:
        return SOMEBODY
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'


def named(endpoints) -> str:
    """The names of the nodes that `endpoints` belong to, each once; empty when there are none."""
    return ', '.join(sorted({full_name(endpoint) for endpoint in endpoints}))


def publishers(node: Node, topic) -> dict:
    """Identity, as bytes -> TopicEndpointInfo of all publishers on `topic`."""
    return {bytes(endpoint.endpoint_gid): endpoint for endpoint in node.get_publishers_info_by_topic(topic)}


def other_publishers(node: Node, topic, published) -> list:
    """The TopicEndpointInfo of all publishers on `topic` but ours; `published` tells whether we have one there."""
    endpoints = node.get_publishers_info_by_topic(topic)
    own = node.get_fully_qualified_name() if published else None
    ours = next((endpoint for endpoint in endpoints if full_name(endpoint) == own), None)
    return [endpoint for endpoint in endpoints if endpoint is not ours]


def unheard(node: Node, subscription) -> list:
    """Why a subscription of `node` hears nothing of publishers on its topic: a sentence for each of them."""
    endpoints = node.get_publishers_info_by_topic(subscription.topic_name)
    return list(filter(None, (_mismatch(node, subscription, endpoint) for endpoint in endpoints)))


def _mismatch(node, subscription, endpoint):
    topic, name = subscription.topic_name, full_name(endpoint)
    kind = subscription.msg_type
    expected = f'{kind.__module__.partition(".")[0]}/msg/{kind.__name__}'
    if endpoint.topic_type != expected:
        return f'{name} publishes {endpoint.topic_type} on {topic}; expected {expected}: not one message of it gets here'
    verdict, reason = qos_check_compatible(endpoint.qos_profile, subscription.qos_profile)
    if verdict != QoSCompatibility.ERROR:
        return ''
    return (f'the quality of service of {name} on {topic} does not suit ours, not one message of it gets here: '
            f'{_difference(node, topic, endpoint.qos_profile, subscription.qos_profile) or reason.strip() or "incompatible"}')


def _difference(node, topic, offered, asked):
    """In which policies less is offered than asked for, and what to do."""
    differences, remedies = [], ['let it publish with ours']
    for policy, (more, less) in POLICIES.items():
        if getattr(asked, policy) == more and getattr(offered, policy) == less:
            differences.append(f'its {policy} is {_words(less)}, ours {_words(more)}')
            ours = f'qos_overrides.{topic}.subscription.{policy}'
            if node.has_parameter(ours):
                remedies.append(f'start this node with {ours}:={less.short_key}')
    return differences and f'{", ".join(differences)}; {", or ".join(remedies)}'


def _words(policy):
    return policy.short_key.replace('_', ' ')


def may_send_odometry(node: Node, endpoint) -> bool:
    """Whether the node that an endpoint belongs to publishes an odometry, or is not discovered yet."""
    try:
        topics = node.get_publisher_names_and_types_by_node(endpoint.node_name, endpoint.node_namespace)
    except RuntimeError:
        return True
    return any('nav_msgs/msg/Odometry' in kinds for _, kinds in topics)


def shared(node: Node, publisher) -> str:
    """Who else publishes on the topic of our `publisher`, and what to do; empty while nobody does."""
    names = named(other_publishers(node, publisher.topic_name, published=True))
    if not names:
        return ''
    own = node.get_fully_qualified_name()
    names = ', '.join(f'another node named {name}' if name == own else name for name in names.split(', '))
    return (f'{publisher.topic_name} is published by {names}, too: who hears it gets two odometries mixed; remap ours, as with '
            '--ros-args -r odom:=laser_odom, or theirs')
