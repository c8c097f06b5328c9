# SPDX-License-Identifier: Apache-2.0
"""What is published for people to look at."""
import numpy as np
import rclpy  # noqa: F401 - needs ROS
from nav_msgs.msg import Path
from ros_helpers import TIMEOUT, shown
from sensor_msgs.msg import PointCloud2, PointField

from dbscan_reg_ros import SE2
from dbscan_reg_ros.node.interfaces.messages import stamp_from_message


def test_the_path_is_where_the_base_has_been(start_node, player, peer, scans, truth):
    start_node('-p', 'path.step:=0.2')
    path = shown(player, peer, scans[:60], Path, 'path')
    assert path.header.frame_id == 'odom'
    assert {pose.header.frame_id for pose in path.poses} == {'odom'}
    stamps = {scan.stamp: pose for scan, pose in zip(scans, truth, strict=True)}
    for stamped in path.poses:
        true = stamps[stamp_from_message(stamped.header.stamp)]
        position, q = stamped.pose.position, stamped.pose.orientation
        assert np.hypot(position.x - true.x, position.y - true.y) < 0.05
        assert q.x**2 + q.y**2 + q.z**2 + q.w**2 == np.float64(1.0).item() or abs(q.z**2 + q.w**2 - 1.0) < 1e-12
    steps = np.diff([[p.pose.position.x, p.pose.position.y] for p in path.poses[:-1]], axis=0)
    assert (np.hypot(*steps.T) >= 0.2).all()


def test_the_path_forgets_its_oldest_poses(start_node, player, peer, scans):
    start_node('-p', 'path.step:=0.0', '-p', 'path.size:=10')
    path = shown(player, peer, scans[:40], Path, 'path')
    assert len(path.poses) <= 11
    assert stamp_from_message(path.poses[0].header.stamp) == scans[30].stamp


def points_of(message):
    assert [(f.name, f.offset, f.datatype, f.count) for f in message.fields] == [
        ('x', 0, PointField.FLOAT32, 1), ('y', 4, PointField.FLOAT32, 1), ('z', 8, PointField.FLOAT32, 1)]
    assert (message.height, message.point_step, message.row_step) == (1, 12, 12 * message.width)
    assert not message.is_bigendian
    return np.frombuffer(message.data, np.float32).reshape(message.width, 3)


def test_the_local_map_lies_on_the_walls(node, player, peer, drive, scans):
    cloud = shown(player, peer, scans[:30], PointCloud2, 'local_map')
    points = points_of(cloud)
    assert cloud.header.frame_id == 'odom'
    assert len(points) > 100
    assert (points[:, 2] == 0.0).all()
    start = SE2.from_array(drive.truth[0]).inverse()
    walls = np.concatenate([(start @ SE2.from_array(pose)).apply(scan.points[scan.valid])
                            for scan, pose in zip(scans[:30], drive.truth, strict=False)])
    nearest = np.sqrt(((points[:, None, :2] - walls[None]) ** 2).sum(axis=2).min(axis=1))
    assert np.median(nearest) < 0.03


def test_images_are_drawn_only_while_there_is_a_subscriber(node, player, peer, scans):
    """Without a subscriber the node draws none, as its counters show."""
    player.wait_for_node(TIMEOUT)
    assert player.play(scans[:10]).lost == 0
    for topic in ('/path', '/local_map', '/segments'):
        assert peer.until(lambda topic=topic: peer.node.get_publishers_info_by_topic(topic))
    maps = peer.subscribe(PointCloud2, 'local_map')
    with peer.spinning():
        assert player.play(scans[10:20]).lost == 0
    peer.until(lambda: maps)
    assert stamp_from_message(maps[0].header.stamp) >= scans[9].stamp
