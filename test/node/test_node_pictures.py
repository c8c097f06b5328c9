# SPDX-License-Identifier: Apache-2.0
"""What is published for people to look at."""
import numpy as np
import rclpy  # noqa: F401 - needs ROS
from nav_msgs.msg import OccupancyGrid, Path
from ros_helpers import LATCHED, TIMEOUT
from scipy.spatial import cKDTree
from sensor_msgs.msg import PointCloud2, PointField

from dbscan_reg_ros.core.scan import in_nanoseconds


def points_of(message):
    assert [(f.name, f.offset, f.datatype, f.count) for f in message.fields] == [
        ('x', 0, PointField.FLOAT32, 1), ('y', 4, PointField.FLOAT32, 1), ('z', 8, PointField.FLOAT32, 1)]
    assert (message.height, message.point_step, message.row_step) == (1, 12, 12 * message.width)
    assert not message.is_bigendian
    return np.frombuffer(message.data, np.float32).reshape(message.width, 3)


def test_path_local_map_and_grid_show_where_the_base_has_been_and_the_walls(start_node, player, peer, scans, truth):
    """Path and local map are drawn once someone subscribes; the grid is there for who comes late."""
    start_node('-p', 'advanced.path.step:=0.2', '-p', 'publish_grid:=true', '-p', 'grid_resolution:=0.1')
    player.wait_for_node(TIMEOUT)
    assert player.play(scans[:10]).lost == 0
    paths, clouds = peer.subscribe(Path, 'path'), peer.subscribe(PointCloud2, 'local_map')
    with peer.spinning():
        assert player.play(scans[10:]).lost == 0
    path, cloud = (peer.until(lambda drawn=drawn: drawn and in_nanoseconds(drawn[-1].header.stamp) == scans[-1].stamp
                              and drawn[-1]) for drawn in (paths, clouds))
    assert in_nanoseconds(clouds[0].header.stamp) >= scans[9].stamp
    grids = peer.listen(OccupancyGrid, '/local_grid', LATCHED)
    grid = peer.until(lambda: grids and grids[-1])
    assert {message.header.frame_id for message in (path, cloud, grid, *path.poses)} == {'odom'}

    stamps = {scan.stamp: pose for scan, pose in zip(scans, truth, strict=True)}
    for stamped in path.poses:
        true = stamps[in_nanoseconds(stamped.header.stamp)]
        position, q = stamped.pose.position, stamped.pose.orientation
        assert np.hypot(position.x - true.x, position.y - true.y) < 0.05
        assert abs(q.z**2 + q.w**2 - 1.0) < 1e-12
    steps = np.diff([[p.pose.position.x, p.pose.position.y] for p in path.poses[:-1]], axis=0)
    assert len(steps) > 5 and (np.hypot(*steps.T) >= 0.2).all()

    points = points_of(cloud)
    assert len(points) > 100 and (points[:, 2] == 0.0).all()
    returns = [pose.apply(scan.points[scan.valid]) for scan, pose in zip(scans, truth, strict=True)]
    assert np.median(cKDTree(np.concatenate(returns)).query(points[:, :2])[0]) < 0.03

    info = grid.info
    assert info.resolution == np.float32(0.1)
    values = np.pad(np.array(grid.data, dtype=int).reshape(info.height, info.width), 1, constant_values=-1)
    assert set(values.ravel()) == {-1, 0, 100}
    corner = np.array((info.origin.position.x, info.origin.position.y))

    def at(points):
        x, y = np.floor((points - corner) / 0.1).astype(int).T + 1
        return values[y, x]

    # Returns of a scan amid the drive lie in occupied cells or beside one; where the robot has been is free.
    around = np.stack([at(returns[20] + 0.1 * np.array((dx, dy))) for dx in (-1, 0, 1) for dy in (-1, 0, 1)])
    assert (around.max(axis=0) == 100).mean() > 0.9
    assert (at(np.array([pose.as_array()[:2] for pose in truth[:60]])) == 0).all()
