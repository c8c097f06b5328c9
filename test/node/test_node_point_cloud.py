# SPDX-License-Identifier: Apache-2.0
"""A 3D lidar, on a tilted mast, in place of a 2D lidar."""
import array
import math

import numpy as np
import rclpy  # noqa: F401 - needs ROS
from nav_msgs.msg import Odometry
from ros_helpers import LATCHED, Loudspeaker, Peer, distances, said, transform
from sensor_msgs.msg import LaserScan, PointCloud2, PointField

from dbscan_reg_ros import SE2
from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.node.interfaces.messages import scan_to_message, stamp_to_message

PITCH, HEIGHT = math.radians(30.0), 0.8
KIND = np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('intensity', '<f4'), ('t', '<u4')])
HEIGHTS = 0.0, 0.3, 0.9, 1.4, 2.4
"""Heights of the returns above the floor [m]: all around at those of the floor and of the ceiling, else on walls."""


def cloud_of(scan, tilted=True, factor=1.0):
    """The message of a 3D lidar that sees walls where `scan` has returns, and the floor and the ceiling before them."""
    flat = scan.points[scan.valid]
    points = np.concatenate([np.column_stack((flat * (1.0 if 0.0 < z < 2.0 else 0.4), np.full(len(flat), z - HEIGHT)))
                             for z in HEIGHTS])
    if tilted:
        c, s = math.cos(PITCH), math.sin(PITCH)
        points = points @ np.array(((c, 0.0, s), (0.0, 1.0, 0.0), (-s, 0.0, c)))
    points = factor * points
    rows = np.zeros(len(points), dtype=KIND)
    for name, values in zip('xyz', points.T, strict=True):
        rows[name] = values
    rows['x'][::7] = np.nan
    message = PointCloud2(height=1, width=len(rows), point_step=KIND.itemsize, row_step=KIND.itemsize * len(rows))
    message.header.stamp, message.header.frame_id = stamp_to_message(scan.stamp), 'mast'
    codes = {'<f4': PointField.FLOAT32, '<u4': PointField.UINT32}
    message.fields = [PointField(name=name, offset=offset, datatype=codes[kind.str], count=1)
                      for name, (kind, offset) in KIND.fields.items()]
    message.data = array.array('B', rows.tobytes())
    return message


def mast():
    message = transform('base_link', 'mast', SE2(0.2, -0.1))
    message.transform.translation.z = HEIGHT
    message.transform.rotation.y, message.transform.rotation.w = math.sin(PITCH / 2.0), math.cos(PITCH / 2.0)
    return message


def followed(found, scans, truth):
    """Distances of the odometry [m] from the true poses of the base, at the scans that have odometry."""
    at = SE2(0.2, -0.1)
    true = {scan.stamp: at @ pose @ at.inverse() for scan, pose in zip(scans, truth, strict=True)}
    return distances(found, [true[in_nanoseconds(message.header.stamp)] for message in found])


def test_a_tilted_3d_lidar_gives_the_odometry_of_the_base(start_command, peer, scans_and_truth, tf_type):
    scans, truth = (each[:40] for each in scans_and_truth)
    node = start_command('scan_matcher', '--ros-args', '-r', 'scan:=points')
    said(node, 'ready: /points', peer)
    Loudspeaker(peer, tf_type, '/tf_static', LATCHED).tell(tf_type(transforms=[mast()]))
    lidar, found = Loudspeaker(peer, PointCloud2, '/points'), peer.subscribe(Odometry, '/odom')
    said(node, '/points: subscribed to sensor_msgs/PointCloud2', peer)
    lidar.until(lambda: found, cloud_of(scans[0]))
    for scan in scans[1:]:
        count = len(found)
        lidar.tell(cloud_of(scan))
        peer.until(lambda count=count: len(found) > count)
    assert followed(found, scans, truth).max() < 0.03
    assert 'skipped' not in node.output() and 'expected sensor_msgs/msg/LaserScan' not in node.output()


def test_only_messages_of_the_given_type_are_received(start_node, peer, scans):
    """Two lidars on one topic: the one with the other type is named, not used."""
    node = start_node('-p', 'input.type:=sensor_msgs/PointCloud2', '-p', 'input.height_min:=-0.6')
    said(node, 'ready: /scan', peer)
    with Peer('flat') as other:
        flat = other.node.create_publisher(LaserScan, '/scan', 10)
        said(node, '/flat publishes sensor_msgs/msg/LaserScan on /scan; expected sensor_msgs/msg/PointCloud2', peer)
        lidar, found = Loudspeaker(peer, PointCloud2, '/scan'), peer.subscribe(Odometry, '/odom')
        flat.publish(scan_to_message(scans[0]))
        lidar.until(lambda: found, cloud_of(scans[5], tilted=False))
    assert {in_nanoseconds(message.header.stamp) for message in found} == {scans[5].stamp}
    assert 'subscribed to sensor_msgs' not in node.output()
