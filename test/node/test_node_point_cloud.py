# SPDX-License-Identifier: Apache-2.0
"""A 3D lidar in place of a 2D lidar."""
import rclpy  # noqa: F401 - needs ROS
from clouds import cloud_of, mast
from nav_msgs.msg import Odometry
from ros_helpers import LATCHED, Loudspeaker, said
from sensor_msgs.msg import PointCloud2

from dbscan_reg_ros.core.scan import in_nanoseconds


def test_the_type_of_the_messages_is_that_of_the_publisher(start_command, peer, scans, tf_type):
    node = start_command('scan_matcher', '--ros-args', '-r', 'scan:=points')
    said(node, 'ready: /points', peer)
    Loudspeaker(peer, tf_type, '/tf_static', LATCHED).tell(tf_type(transforms=[mast()]))
    lidar, found = Loudspeaker(peer, PointCloud2, '/points'), peer.subscribe(Odometry, '/odom')
    said(node, '/points: subscribed to sensor_msgs/PointCloud2', peer)
    lidar.until(lambda: found, cloud_of(scans[0]))
    lidar.until(lambda: in_nanoseconds(found[-1].header.stamp) == scans[1].stamp, cloud_of(scans[1]))
    assert 'skipped' not in node.output() and 'expected sensor_msgs/msg/LaserScan' not in node.output()
