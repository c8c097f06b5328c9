# SPDX-License-Identifier: Apache-2.0
"""What the node is told of the motion before it looks at the scans."""
import rclpy  # noqa: F401 - needs ROS
from nav_msgs.msg import Odometry
from ros_helpers import TIMEOUT, Loudspeaker
from sensor_msgs.msg import Imu
from std_srvs.srv import Trigger

from dbscan_reg_ros.node.interfaces.messages import pose_to_message, stamp_to_message
from dbscan_reg_ros.recordings.snapshots import read_snapshot


def test_wheels_and_gyroscope_are_used(start_node, player, peer, scans, truth, tmp_path):
    """They are received reliably, so that none is lost on a busy machine."""
    reliable = [word for topic in ('wheel_odom', 'imu')
                for word in ('-p', f'qos_overrides./{topic}.subscription.reliability:=reliable')]
    start_node('-p', 'prior.source:=odometry+imu', '-p', f'advanced.snapshot.folder:={tmp_path}', *reliable)
    player.wait_for_node(TIMEOUT)
    driven, turned = [], []
    for scan, pose in zip(scans[:20], truth, strict=False):
        driven.append(Odometry())
        turned.append(Imu())
        driven[-1].header.stamp = turned[-1].header.stamp = stamp_to_message(scan.stamp)
        driven[-1].pose.pose = pose_to_message(pose)
    Loudspeaker(peer, Odometry, 'wheel_odom').tell(*driven)
    Loudspeaker(peer, Imu, 'imu').tell(*turned)
    assert player.play(scans[:20]).lost == 0
    answer = peer.call(Trigger, '/scan_matcher/snapshot', Trigger.Request())
    assert answer.success and answer.message.startswith(str(tmp_path))
    before, *priors = [update.prior for update in read_snapshot(answer.message).updates]
    assert before is None and {prior.transform.theta for prior in priors} == {0.0}, 'as the gyroscope says'
    assert all(prior.transform.x for prior in priors), 'as the wheels say'
