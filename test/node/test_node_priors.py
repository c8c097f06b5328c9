# SPDX-License-Identifier: Apache-2.0
"""What the node believes of the motion before it looks at the scans."""
import itertools
import math

import pytest
import rclpy  # noqa: F401 - needs ROS
from nav_msgs.msg import Odometry
from ros_helpers import TIMEOUT, Loudspeaker, distances, mounted, of_base
from sensor_msgs.msg import Imu
from std_srvs.srv import Trigger

from dbscan_reg_ros import SE2
from dbscan_reg_ros.node.interfaces.messages import pose_to_message, stamp_to_message
from dbscan_reg_ros.recordings.snapshots import read_snapshot

LASER = SE2(0.2, 0.1, 0.5)
"""On the base."""
PLACE = mounted(LASER)
WAIT = ['-p', 'advanced.input.max_wait:=5.0']


def along_base(motion):
    """A motion of the laser as that of a sensor in its place that looks along the base."""
    return SE2(0.0, 0.0, LASER.theta) @ motion @ SE2(0.0, 0.0, -LASER.theta)


def wheel(stamp, pose):
    message = Odometry()
    message.header.stamp = stamp_to_message(stamp)
    message.pose.pose = pose_to_message(pose)
    return message


def turning(stamp, rate):
    message = Imu()
    message.header.stamp = stamp_to_message(stamp)
    message.angular_velocity.z = rate
    return message


def between(scans, truth):
    """(stamp, true pose of the base) halfway between the scans, and a little before the first and after the last."""
    bases = [SE2(9.0, -4.0, 2.0) @ pose @ LASER.inverse() for pose in truth]
    yield scans[0].stamp - 50_000_000, bases[0]
    for (a, b), (p, q) in zip(itertools.pairwise(scans), itertools.pairwise(bases), strict=True):
        step = p.inverse() @ q
        yield (a.stamp + b.stamp) // 2, p @ SE2(0.5 * step.x, 0.5 * step.y, 0.5 * step.theta)
    yield scans[-1].stamp + 50_000_000, bases[-1]


def priors_taken(peer, folder):
    """External priors that the odometry used, from a snapshot."""
    answer = peer.call(Trigger, '/scan_matcher/snapshot', Trigger.Request())
    assert answer.success, answer.message
    assert answer.message.startswith(str(folder))
    return read_snapshot(answer.message).updates


@pytest.fixture
def start_with(start_command, tmp_path):
    """``start_with(source, *words)``: a node that receives each message of the source, also on a busy machine."""
    reliable = [word for topic in ('wheel_odom', 'imu')
                for word in ('-p', f'qos_overrides./{topic}.subscription.reliability:=reliable')]
    return lambda source, *words: start_command('scan_matcher', '--ros-args', '-p', f'prior.source:={source}', '-p',
                                                f'advanced.snapshot.folder:={tmp_path}', *reliable, *words)


def test_wheels_give_the_translation_and_the_gyroscope_the_rotation(start_with, player, peer, scans, truth, tmp_path):
    """The heading of the wheels is off by 0.08 rad in two of four messages, its change by 0.04 rad at each scan."""
    start_with('odometry+imu', *PLACE, *WAIT)
    player.wait_for_node(TIMEOUT)
    wheels, imu = Loudspeaker(peer, Odometry, 'wheel_odom'), Loudspeaker(peer, Imu, 'imu')
    wheels.tell(*(wheel(stamp, pose @ SE2(theta=0.08 * (k // 2 % 2)))
                  for k, (stamp, pose) in enumerate(between(scans[:20], truth[:20]))))
    rates = [(b.theta - a.theta + math.pi) % (2.0 * math.pi) - math.pi for a, b in itertools.pairwise(truth[:21])]
    imu.tell(turning(scans[0].stamp - 1, 0.0), *(turning(scan.stamp + k * 10_000_000, 10.0 * rate) for scan, rate in
                                                 zip(scans, rates, strict=False) for k in range(0, 10, 5)))
    answers = player.play(scans[:20])
    assert answers.lost == 0 and distances(answers.messages, of_base(truth[:20], LASER)).max() < 0.05
    updates = priors_taken(peer, tmp_path)
    assert sum(update.prior is not None for update in updates) == 19
    for update, before, now in zip(updates[1:], truth, truth[1:], strict=False):
        error = along_base(before.inverse() @ now).inverse() @ update.prior.transform
        assert error.as_array() == pytest.approx([0.0, 0.0, 0.0], abs=0.02)
