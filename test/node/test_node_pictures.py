# SPDX-License-Identifier: Apache-2.0
"""What is published for people to look at."""
import numpy as np
import rclpy  # noqa: F401 - needs ROS
from nav_msgs.msg import OccupancyGrid, Path
from ros_helpers import LATCHED, TIMEOUT, shown
from scipy.spatial import cKDTree
from sensor_msgs.msg import PointCloud2, PointField

from dbscan_reg_ros import SE2
from dbscan_reg_ros.core.scan import in_nanoseconds


def test_the_path_is_where_the_base_has_been(start_node, player, peer, scans, truth):
    start_node('-p', 'advanced.path.step:=0.2')
    path = shown(player, peer, scans[:60], Path, 'path')
    assert path.header.frame_id == 'odom'
    assert {pose.header.frame_id for pose in path.poses} == {'odom'}
    stamps = {scan.stamp: pose for scan, pose in zip(scans, truth, strict=True)}
    for stamped in path.poses:
        true = stamps[in_nanoseconds(stamped.header.stamp)]
        position, q = stamped.pose.position, stamped.pose.orientation
        assert np.hypot(position.x - true.x, position.y - true.y) < 0.05
        assert q.x**2 + q.y**2 + q.z**2 + q.w**2 == np.float64(1.0).item() or abs(q.z**2 + q.w**2 - 1.0) < 1e-12
    steps = np.diff([[p.pose.position.x, p.pose.position.y] for p in path.poses[:-1]], axis=0)
    assert (np.hypot(*steps.T) >= 0.2).all()


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
    assert np.median(cKDTree(walls).query(points[:, :2])[0]) < 0.03


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
    assert in_nanoseconds(maps[0].header.stamp) >= scans[9].stamp


def test_the_grid_shows_walls_and_free_space_to_who_comes_late(start_node, player, peer, drive, scans, truth):
    start_node('-p', 'publish_grid:=true', '-p', 'grid_resolution:=0.1')
    player.wait_for_node(TIMEOUT)
    with peer.spinning():
        assert player.play(scans).lost == 0
    grids = peer.listen(OccupancyGrid, '/local_grid', LATCHED)
    grid = peer.until(lambda: grids and grids[-1])
    info = grid.info
    assert grid.header.frame_id == 'odom' and info.resolution == np.float32(0.1)
    values = np.pad(np.array(grid.data, dtype=int).reshape(info.height, info.width), 1, constant_values=-1)
    assert set(values.ravel()) == {-1, 0, 100}
    corner = np.array((info.origin.position.x, info.origin.position.y))

    def at(points):
        x, y = np.floor((points - corner) / 0.1).astype(int).T + 1
        return values[y, x]

    # Returns of a scan amid the drive lie in occupied cells or beside one; where the robot has been is free.
    walls = truth[20].apply(scans[20].points[scans[20].valid])
    around = np.stack([at(walls + 0.1 * np.array((dx, dy))) for dx in (-1, 0, 1) for dy in (-1, 0, 1)])
    assert (around.max(axis=0) == 100).mean() > 0.9
    assert (at(np.array([pose.as_array()[:2] for pose in truth[:60]])) == 0).all()
