# SPDX-License-Identifier: Apache-2.0
"""Time: simulated, in a loop, going back, at zero, in the future."""
import math

import pytest
import rclpy  # noqa: F401 - needs ROS
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from ros_helpers import TIMEOUT, Loudspeaker, distances, played, pose_of, restamped, said
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool

from dbscan_reg_ros import SE2
from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.node.interfaces.messages import stamp_to_message

SECOND = 1_000_000_000


def test_between_scans_odom_and_transform_are_predicted(start_node, player, peer, scans):
    """Stamps of odom increase, every scan has its transform, and nothing is sent after `coast_time` or in a pause."""
    tf_type = pytest.importorskip('tf2_msgs.msg', reason='needs tf2_msgs (scripts/tf2_msgs/build.py)').TFMessage
    start_node('-p', 'use_sim_time:=true', '-p', 'publish_rate:=50.0')
    odom, transforms = peer.subscribe(Odometry, '/odom'), peer.subscribe(tf_type, '/tf')
    clock = Loudspeaker(peer, Clock, '/clock')
    assert played(player, scans[:20]).lost == 0

    def at(stamp):
        clock.tell(Clock(clock=stamp_to_message(stamp)))
        peer.greet()

    peer.until(lambda: len(odom) == 20)
    last = pose_of(odom[-1])
    for ahead in (40, 80, 150, 900, 1100, 1200):
        at(scans[19].stamp + ahead * SECOND // 1000)
    stamps = [in_nanoseconds(message.header.stamp) - scans[19].stamp for message in odom[20:]]
    assert [stamp // 1_000_000 for stamp in stamps] == [40, 80, 150, 900]
    velocity = odom[19].twist.twist.linear
    assert math.hypot(pose_of(odom[21]).x - last.x, pose_of(odom[21]).y - last.y) == pytest.approx(
        0.08 * math.hypot(velocity.x, velocity.y), rel=1e-3)
    assert odom[22].pose.covariance[0] > odom[20].pose.covariance[0] > odom[19].pose.covariance[0]
    player.play(scans[20:30], patience=0.3)
    sent = peer.until(lambda: len(transforms) >= 34 and transforms)
    assert {scan.stamp for scan in scans[:30]} <= {in_nanoseconds(m.transforms[0].header.stamp) for m in sent}
    stamps = [in_nanoseconds(message.header.stamp) for message in odom]
    assert stamps == sorted(set(stamps))
    assert peer.call(SetBool, '/scan_matcher/pause', SetBool.Request(data=True)).success
    count = len(transforms)
    at(scans[29].stamp + 20_000_000)
    assert len(transforms) == count


def test_a_looped_bag_restarts_the_odometry_with_each_loop(node, player, peer, scans, truth):
    """Stamps that go back by seconds are a recording that starts again."""
    tf_type = pytest.importorskip('tf2_msgs.msg', reason='needs tf2_msgs (scripts/tf2_msgs/build.py)').TFMessage
    player.wait_for_node(TIMEOUT)
    received = peer.subscribe(tf_type, '/tf')
    for _ in range(2):
        answers = player.play(scans[:50])
        assert answers.lost == 0
        assert pose_of(answers.messages[0]) == SE2()
        assert distances(answers.messages, truth[:50]).max() < 0.05
    said(node, 'odometry reset: the stamps of the scans start again', peer)
    assert 'tracking restarted' not in node.output()
    peer.until(lambda: len(received) == 100)


def test_a_clock_that_goes_far_back_resets_the_odometry(start_node, player, peer, scans):
    node = start_node('-p', 'use_sim_time:=true')
    player.wait_for_node(TIMEOUT)
    received = peer.listen(DiagnosticArray, '/diagnostics')
    clock = Loudspeaker(peer, Clock, '/clock', 1)
    ahead, back = (Clock(clock=stamp_to_message(scans[k].stamp)) for k in (40, 15))
    assert player.play(scans[15:20]).lost == 0
    clock.until(lambda: received and received[-1].header.stamp == ahead.clock, ahead)
    clock.until(lambda: 'the clock went back by 2.5 s' in node.output(), back)
    assert pose_of(player.play(scans[20:21]).messages[0]) == SE2()


def test_a_single_scan_with_a_wrong_stamp_does_not_restart_the_odometry(node, player, peer, scans, truth):
    """One far back is skipped with the reason; one far ahead is used."""
    wrong = restamped(scans[30:31], [scans[30].stamp - 1000 * SECOND])
    answers = played(player, [*scans[:30], *wrong, *scans[31:40]])
    assert [k for k, message in enumerate(answers.messages) if message is None] == [30]
    assert distances(answers.messages[31:], truth[31:40]).max() < 0.05
    said(node, 'scan skipped: its stamp lies far before those of the scans around it', peer)
    assert player.play(restamped(scans[40:41], [2_100_000_000 * SECOND])).lost == 0
    answers = player.play(scans[41:50])
    assert answers.lost == 0
    assert distances(answers.messages, truth[41:50]).max() < 0.3
    assert 'odometry reset' not in node.output()
