# SPDX-License-Identifier: Apache-2.0
"""/diagnostics: the status that the node publishes once a second."""
import math

import numpy as np
import pytest
import rclpy
import rclpy.qos
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from ros_helpers import TIMEOUT, Loudspeaker, Peer, diagnosis, played, said
from sensor_msgs.msg import Imu, LaserScan
from std_srvs.srv import SetBool

from dbscan_reg_ros import Scan, ScanGeometry
from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.node.interfaces.graph_checks import full_name, named
from dbscan_reg_ros.node.interfaces.messages import scan_to_message

START = 1_700_000_000 * 10**9


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


@pytest.mark.long
def test_diagnostics_are_published_no_more_than_once_a_second(node, peer, reports):
    """Also without scans. A late one is followed by the next at its own time, at most a second earlier."""
    received = reports()
    peer.until(lambda: len(received) >= 4)
    first, last = (in_nanoseconds(message.header.stamp) for message in (received[0], received[3]))
    assert last - first > 2_000_000_000


def walls(count):
    """Scans between two endless walls, one 1.5 m to the left and one 0.8 m to the right, that run along 0.5 rad."""
    rng = np.random.default_rng(1)
    geometry = ScanGeometry(-3.1, 0.017, 360, 0.05, 8.0)
    across = np.sin(geometry.bearings - 0.5)
    ranges = np.where(across > 0.0, 1.5, 0.8) / np.maximum(np.abs(across), 1e-3)
    for k in range(count):
        yield Scan(START + k * 100_000_000, ranges + rng.normal(0.0, 0.005, 360), geometry, 0.0, 'laser')


def test_between_two_walls_the_degenerate_direction_is_reported(node, player, peer, reports):
    player.wait_for_node(TIMEOUT)
    received = reports()
    peer.greet()
    with peer.spinning():
        assert player.play(walls(30), rate=1.0).lost == 0
    reported = [s for m in received for s in m.status if level(s) == 'warn'
                and s.message.startswith('degenerate, along')]
    assert reported, [s.message for m in received for s in m.status]
    assert math.remainder(float(values(reported[0])['degenerate direction [rad]']) - 0.5,
                          math.pi) == pytest.approx(0.0, abs=0.05)
    assert 'along 29 deg' in reported[0].message or 'along 28 deg' in reported[0].message
    assert int(values(reported[-1])['status degenerate']) > 0


def test_lost_is_an_error_with_the_reason(node, player, peer, reports, scans):
    player.wait_for_node(TIMEOUT)
    received = reports()
    peer.greet()
    rng = np.random.default_rng(1)
    assert player.play(scans[:3]).lost == 0
    noise = [type(s)(s.stamp, rng.uniform(0.5, 20.0, s.geometry.size), s.geometry, 0.0, 'laser') for s in scans[3:23]]
    with peer.spinning():
        player.play(noise, rate=1.0)
    reported = [s for m in received for s in m.status if level(s) == 'error']
    assert any(s.message.startswith('lost: ') and len(s.message) > len('lost: ') for s in reported)
    assert int(values(reported[-1])['status failed']) > 0


def test_a_mounting_that_is_not_known_is_an_error(start_command, peer, reports, scans):
    pytest.importorskip('tf2_msgs', reason='needs tf2_msgs (scripts/tf2_msgs/build.py)')
    start_command('scan_matcher')
    received = reports()
    speaker = Loudspeaker(peer, LaserScan, 'scan')
    seen = speaker.until(lambda: [s for m in received for s in m.status if 'no transform from' in s.message],
                         scan_to_message(scans[0]))
    assert level(seen[0]) == 'error'


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


BEST_EFFORT = rclpy.qos.qos_profile_sensor_data


def test_a_pose_with_incompatible_best_effort_qos_is_reported(node, player, peer, reports, scans):
    received = reports()
    peer.node.create_publisher(PoseWithCovarianceStamped, 'set_pose', BEST_EFFORT)
    status = diagnosis(peer, received, lambda s: '/set_pose' in s.message and '/play' in s.message)
    reported = ('the quality of service of /peer on /set_pose is incompatible with ours, its messages are not '
                'received: its reliability is best effort, ours reliable; let it publish with ours, or start this node '
                'with qos_overrides./set_pose.subscription.reliability:=best_effort')
    assert level(status) == 'stale'
    assert status.message == f'no scans on /scan: /play publishes there, but no scan is received; {reported}'
    said(node, reported, peer)
    played(player, scans[:3])
    status = diagnosis(peer, received, lambda s: level(s) == 'warn')
    assert reported in status.message
    assert node.output().count(reported) == 1


@pytest.mark.long
@pytest.mark.parametrize('source, topic, kind', [('odometry', 'wheel_odom', Odometry), ('imu', 'imu', Imu)])
def test_a_prior_with_an_incompatible_qos_is_reported(start_node, peer, reports, source, topic, kind):
    override = f'qos_overrides./{topic}.subscription.reliability'
    node = start_node('-p', f'prior.source:={source}', '-p', f'{override}:=reliable')
    received = reports()
    peer.node.create_publisher(kind, topic, BEST_EFFORT)
    reported = (f'the quality of service of /peer on /{topic} is incompatible with ours, its messages are not '
                'received: its reliability is best effort, ours reliable; let it publish with ours, or start this node '
                f'with {override}:=best_effort')
    diagnosis(peer, received, lambda s: reported in s.message)
    said(node, reported, peer)


@pytest.mark.long
def test_volatile_static_transforms_are_reported_as_incompatible(node, peer, reports):
    tf_type = pytest.importorskip('tf2_msgs.msg', reason='needs tf2_msgs (scripts/tf2_msgs/build.py)').TFMessage
    received = reports()
    peer.node.create_publisher(tf_type, '/tf_static', 10)
    diagnosis(peer, received, lambda s: '/tf_static' in s.message)
    said(node,
         'the quality of service of /peer on /tf_static is incompatible with ours, its messages are not received: '
         'its durability is volatile, ours transient local; let it publish with ours', peer)


@pytest.mark.parametrize('source, topic, expected', [('imu', 'imu', 'sensor_msgs/msg/Imu')])
def test_a_prior_of_another_type_is_reported(start_node, peer, reports, source, topic, expected):
    node = start_node('-p', f'prior.source:={source}')
    received = reports()
    peer.node.create_publisher(PoseWithCovarianceStamped, topic, 10)
    reported = f'/peer publishes geometry_msgs/msg/PoseWithCovarianceStamped on /{topic}; expected {expected}: ' \
           'its messages are not received'
    diagnosis(peer, received, lambda s: reported in s.message)
    said(node, reported, peer)


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


def test_a_second_node_of_our_name_on_our_odometry_is_named(start_node, player, peer, reports):
    first, second = start_node(), start_node()
    for node in (first, second):
        said(node, '/odom is also published by another node named /scan_matcher', peer)


class Endpoint:
    """A publisher that is discovered before its node, as rmw reports it."""

    node_name = '_NODE_NAME_UNKNOWN_'
    node_namespace = '_NODE_NAMESPACE_UNKNOWN_'


def test_a_node_that_is_not_discovered_is_unnamed():
    known = type('Known', (Endpoint,), {'node_name': '_ros2cli_17', 'node_namespace': '/'})
    assert full_name(Endpoint) == 'an unnamed node'
    assert named([Endpoint, known, Endpoint]) == '/_ros2cli_17, an unnamed node'
    assert named([]) == ''


def test_a_paused_node_reports_its_state(node, player, peer, reports, scans):
    assert played(player, scans[:3]).lost == 0
    received = reports()
    assert peer.call(SetBool, '/scan_matcher/pause', SetBool.Request(data=True)).success
    status = diagnosis(peer, received, lambda s: s.message == 'paused')
    assert level(status) == 'ok'
