# SPDX-License-Identifier: Apache-2.0
"""The quality of service of the node's publishers and subscriptions, as parameters tell it, seen over DDS."""
import rclpy  # noqa: F401 - needs ROS
from lifecycle_msgs.msg import State, Transition
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from ros_helpers import Parameters, said
from test_node_lifecycle import change, state


def overridden(name, **policies):
    """ROS arguments that set the policies of the endpoint `name`, such as ``/odom.publisher``."""
    return [word for policy, value in policies.items() for word in ('-p', f'qos_overrides.{name}.{policy}:={value}')]


def quality(peer, topic, entity='publisher'):
    """The QoSProfile that scan_matcher's endpoint on `topic` has."""
    listed = getattr(peer.node, f'get_{entity}s_info_by_topic')
    [found] = peer.until(lambda: [e for e in listed(topic) if e.node_name == 'scan_matcher'])
    return found.qos_profile


def test_endpoints_have_the_quality_of_service_that_is_asked_for_by_their_full_names(start_node, peer):
    topic = '/robot1/laser_odom'
    start_node('-r', '__ns:=/robot1', '-r', 'odom:=laser_odom', '-p', 'prior.source:=odometry+imu',
               *overridden(f'{topic}.publisher', reliability='best_effort', durability='transient_local', depth=7),
               *overridden('/robot1/imu.subscription', reliability='reliable'))
    found = quality(peer, topic)
    assert (found.reliability, found.durability) == (ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.TRANSIENT_LOCAL)
    names = [f'qos_overrides.{topic}.publisher.{policy}' for policy in ('depth', 'reliability', 'durability',
                                                                        'history')]
    assert Parameters(peer, '/robot1/scan_matcher').get(*names) == [7, 'best_effort', 'transient_local', 'keep_last']
    assert quality(peer, '/robot1/path').reliability == ReliabilityPolicy.RELIABLE
    for name, expected in ('wheel_odom', 'BEST_EFFORT'), ('set_pose', 'RELIABLE'), ('imu', 'RELIABLE'):
        assert quality(peer, f'/robot1/{name}', 'subscription').reliability == ReliabilityPolicy[expected]


def test_a_lifecycle_node_that_fails_to_configure_leaves_no_publisher(start_command, peer):
    node = start_command('scan_matcher_lifecycle', '--ros-args', '-p', 'mounting:=none',
                         *overridden('/path.publisher', reliability='nonsense'))
    for _ in range(2):
        assert not change(peer, Transition.TRANSITION_CONFIGURE)
        assert state(peer) == State.PRIMARY_STATE_UNCONFIGURED
    said(node, "'reliability': 'nonsense'", peer)
    peer.until(lambda: not peer.node.get_publishers_info_by_topic('/odom'))
