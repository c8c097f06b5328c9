# SPDX-License-Identifier: Apache-2.0
"""Simulated time."""
import rclpy  # noqa: F401 - needs ROS
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from ros_helpers import TIMEOUT, Loudspeaker, pose_of
from rosgraph_msgs.msg import Clock

from dbscan_reg_ros import SE2
from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.node.interfaces.messages import stamp_to_message


def test_the_clock_asks_for_odometry_between_scans_and_resets_it_when_it_goes_far_back(start_node, player, peer, scans):
    node = start_node('-p', 'use_sim_time:=true', '-p', 'publish_rate:=50.0')
    player.wait_for_node(TIMEOUT)
    received, odom = peer.listen(DiagnosticArray, '/diagnostics'), peer.subscribe(Odometry, '/odom')
    clock = Loudspeaker(peer, Clock, '/clock', 1)
    soon, ahead, back = (stamp_to_message(stamp) for stamp in (
        scans[19].stamp + 40_000_000, scans[40].stamp, scans[15].stamp))
    assert player.play(scans[15:20]).lost == 0
    peer.until(lambda: len(odom) == 5 and received)
    clock.until(lambda: odom[-1].header.stamp == soon, Clock(clock=soon))
    assert [in_nanoseconds(each.header.stamp) - scans[19].stamp for each in odom[-2:]] == [0, 40_000_000]
    clock.until(lambda: received[-1].header.stamp == ahead, Clock(clock=ahead))
    clock.until(lambda: 'the clock went back by 2.5 s' in node.output(), Clock(clock=back))
    assert pose_of(player.play(scans[20:21]).messages[0]) == SE2()
