# SPDX-License-Identifier: Apache-2.0
"""/diagnostics: the status that the node publishes once a second."""

import pytest
import rclpy
import rclpy.qos
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Odometry
from ros_helpers import TIMEOUT, Peer, diagnosis, played, said
from sensor_msgs.msg import LaserScan

from dbscan_reg_ros.node.interfaces.graph_checks import full_name, named
from dbscan_reg_ros.node.interfaces.messages import scan_to_message


@pytest.fixture
def reports(peer):
    return lambda: peer.listen(DiagnosticArray, '/diagnostics')


def values(status):
    return {pair.key: pair.value for pair in status.values}


def level(status):
    return {DiagnosticStatus.OK: 'ok', DiagnosticStatus.WARN: 'warn', DiagnosticStatus.ERROR: 'error',
            DiagnosticStatus.STALE: 'stale'}[status.level]


def test_without_scans_the_topic_and_its_publishers_are_named(start_node, peer, reports):
    start_node('-r', '__ns:=/robot')
    received = reports()
    status = diagnosis(peer, received, lambda s: level(s) == 'stale')
    assert status.name == '/robot/scan_matcher: laser odometry'
    assert status.message == 'no scans on /robot/scan: no node publishes there'
    peer.node.create_publisher(LaserScan, '/robot/front/scan', 10)
    assert diagnosis(peer, received, lambda s: '-r scan:=/robot/front/scan' in s.message)
    peer.node.create_publisher(LaserScan, '/robot/scan', 10)
    assert diagnosis(peer, received, lambda s: '/peer publishes there, but no scan is received' in s.message)


def test_tracking_is_ok_with_rates_timing_and_counts(node, player, peer, reports, scans):
    player.wait_for_node(TIMEOUT)
    received = reports()
    peer.greet()
    with peer.spinning():
        answers = player.play(scans[:40], rate=1.0)
    assert answers.lost == 0
    reported = [s for m in received for s in m.status if level(s) == 'ok' and s.message == 'tracking']
    assert len(reported) >= 3
    numbers = values(reported[-2])
    assert float(numbers['scan rate [Hz]']) == pytest.approx(10.0, abs=2.0)
    assert float(numbers['odometry rate [Hz]']) == pytest.approx(10.0, abs=2.0)
    assert 0.0 < float(numbers['processing time median [ms]']) <= float(numbers['processing time maximum [ms]'])
    assert float(numbers['overlap']) > 0.7
    assert numbers['scans dropped'] == numbers['scans skipped'] == '0'
    assert numbers['scans processed'] == numbers['status ok']
    assert reported[-1].hardware_id == 'laser'
    silent = diagnosis(peer, received, lambda s: level(s) == 'stale')
    assert silent.message.startswith('no scans on /scan: ')
    assert values(silent)['scans processed'] == '40'


def test_an_incompatible_scan_qos_is_reported_in_words(start_node, peer, reports, scans):
    node = start_node('-p', 'qos_overrides./scan.subscription.reliability:=reliable')
    received = reports()
    publisher = peer.node.create_publisher(LaserScan, 'scan', rclpy.qos.qos_profile_sensor_data)
    status = diagnosis(peer, received, lambda s: 'quality of service' in s.message)
    assert level(status) == 'stale'
    assert 'the quality of service of /peer on /scan is incompatible with ours' in status.message
    assert 'its reliability is best effort, ours reliable; let it publish with ours, or start this node with ' \
           'qos_overrides./scan.subscription.reliability:=best_effort' in status.message
    publisher.publish(scan_to_message(scans[0]))
    said(node, 'the quality of service of /peer on /scan', peer)


def test_another_publisher_on_our_odometry_is_named(node, player, peer, reports, scans):
    received = reports()
    with Peer('base_driver') as driver:
        driver.node.create_publisher(Odometry, 'odom', 10)
        status = diagnosis(peer, received, lambda s: '/odom' in s.message)
        reported = '/odom is also published by /base_driver: subscribers receive two odometries mixed; remap ours'
        assert reported in status.message
        said(node, reported, peer)
        played(player, scans[:3])
        assert reported in diagnosis(peer, received, lambda s: level(s) == 'warn').message
    played(player, scans[3:6])
    diagnosis(peer, received, lambda s: '/odom' not in s.message)
    assert node.output().count(reported) == 1


class Endpoint:
    """A publisher that is discovered before its node, as rmw reports it."""

    node_name = '_NODE_NAME_UNKNOWN_'
    node_namespace = '_NODE_NAMESPACE_UNKNOWN_'


def test_a_node_that_is_not_discovered_is_unnamed():
    known = type('Known', (Endpoint,), {'node_name': '_ros2cli_17', 'node_namespace': '/'})
    assert full_name(Endpoint) == 'an unnamed node'
    assert named([Endpoint, known, Endpoint]) == '/_ros2cli_17, an unnamed node'
    assert named([]) == ''
