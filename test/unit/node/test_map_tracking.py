# SPDX-License-Identifier: Apache-2.0
"""Maps as messages, and the thread in which the robot is tracked."""
import array
import math
import os
import sys

import numpy as np
import pytest
import rclpy  # noqa: F401 - needs ROS
from geometry_msgs.msg import Quaternion
from nav_msgs.msg import OccupancyGrid

from dbscan_reg_ros import SE2, Map, Odometry, Parameters
from dbscan_reg_ros.node.map.messages import graph_to_message, grid_from_message, grid_to_message
from dbscan_reg_ros.node.map.tracking import NICENESS, Tracking
from dbscan_reg_ros.places.grid import Grid
from dbscan_reg_ros.places.localizer import State
from dbscan_reg_ros.places.pose_graph import Constraints, PoseGraph
from dbscan_reg_ros.robot.base_state import InitialPose

LASER = SE2(0.3, 0.1)
"""Pose of the laser on the base."""


def received(values, width, resolution=0.5):
    message = OccupancyGrid(data=array.array('b', values))
    message.info.width, message.info.height, message.info.resolution = width, len(values) // width, resolution
    return message


def test_a_map_keeps_its_cells_and_its_turned_origin_in_a_message():
    grid = Grid(np.array([[0, 100, -1], [100, 0, 0]], dtype=np.int8), SE2(1.0, -2.0, 0.7), 0.05)
    message = grid_to_message(grid, 3_000_000_005, 'floor')
    assert (message.header.frame_id, message.header.stamp.sec, message.header.stamp.nanosec) == ('floor', 3, 5)
    assert list(message.data) == [0, 100, -1, 100, 0, 0] and message.info.width == 3
    again = grid_from_message(message)
    assert np.array_equal(again.values, grid.values)
    assert again.origin.as_array() == pytest.approx(grid.origin.as_array())
    assert again.resolution == pytest.approx(0.05)


def test_cells_that_are_neither_probably_free_nor_probably_occupied_are_unknown():
    values = grid_from_message(received([0, 25, 26, 64, 65, 100, -1, -128], 4)).values[1:-1, 1:-1]
    assert values.tolist() == [[0, 0, -1, -1], [100, 100, -1, -1]]


def test_a_map_whose_sizes_do_not_fit_is_refused():
    short = received([0] * 6, 3)
    short.info.height = 3
    for message in short, received([0] * 6, 3, 0.0), received([0] * 6, 3, math.nan), OccupancyGrid():
        with pytest.raises(ValueError, match='expected'):
            grid_from_message(message)
    turned = received([0] * 6, 3)
    turned.info.origin.orientation = Quaternion(w=0.0)
    with pytest.raises(ValueError, match='quaternion'):
        grid_from_message(turned)


def test_the_graph_is_drawn_by_its_chain_and_its_loops():
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]])
    pairs = np.array([[0, 1], [1, 2], [0, 2]])
    graph = PoseGraph(poses, Constraints(pairs, np.zeros((3, 3)), np.repeat(np.eye(3)[None], 3, axis=0)))
    frames, chain, loops = graph_to_message(graph, 0, 'map').markers
    assert [(point.x, point.y) for point in frames.points] == [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)]
    assert [(point.x, point.y) for point in chain.points] == [(0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (1.0, 1.0)]
    assert [(point.x, point.y) for point in loops.points] == [(0.0, 0.0), (1.0, 1.0)]
    assert frames.action == chain.action == loops.action == frames.ADD
    assert graph_to_message(PoseGraph(poses[:1], graph.constraints.loops._replace(pairs=np.empty((0, 2), dtype=int))),
                            0, 'map').markers[2].action == loops.DELETE


@pytest.fixture(scope='module')
def updates(drive):
    odometry = Odometry()
    return [odometry.process(scan) for scan in drive.scans[:60]]


def test_a_map_is_built_saved_and_begun_anew(updates, tmp_path):
    tracking, file = Tracking(Parameters(), builds=True), tmp_path / 'new' / 'map.npz'
    assert tracking.save(file).result() == 'no scan was processed yet' and tracking.draw().result() is None
    for update in updates:
        tracking.process(update, LASER)
    assert tracking.save(file).result() == ''
    found = list(tracking.results)
    assert [each.stamp for each in found] == [update.stamp for update in updates]
    assert found[-1].base.pose.as_array() == pytest.approx((updates[-1].pose @ LASER.inverse()).as_array(), abs=0.02)
    made = Map.load(file)
    assert made.mounting == LASER and len(made.views) >= 3
    picture = tracking.draw().result()
    assert np.array_equal(picture.graph.poses, made.graph.poses) and tracking.draw().result() is None
    (tmp_path / 'file').touch()
    assert 'cannot be written: ' in tracking.save(tmp_path / 'file' / 'map.npz').result()
    tracking.restart()
    assert not tracking.results
    tracking.process(updates[0], LASER)
    assert tracking.save(file).result() == '' and len(Map.load(file).views) == 1
    tracking.close()


def test_a_pose_that_was_set_before_the_map_came_counts_and_outlives_another_map(updates):
    builder = Tracking(Parameters(), builds=True)
    for update in updates:
        builder.process(update, LASER)
    grid = builder.draw().result().grid
    builder.close()
    tracking = Tracking(Parameters(), builds=False)
    start = updates[20].pose @ LASER.inverse()
    tracking.set_pose(InitialPose(start, np.diag([0.04, 0.04, 0.01])))
    for update in updates[20:24]:
        tracking.process(update, LASER)
    tracking.use_map(grid)
    for update in updates[24:40]:
        tracking.process(update, LASER)
    tracking.use_map(grid)
    tracking.process(updates[40], LASER)
    tracking.draw().result()
    found = list(tracking.results)
    assert [each.stamp for each in found] == [update.stamp for update in updates[24:41]]
    assert {each.known.state for each in found[1:]} == {State.LOCALISED}
    off = found[-1].base.pose.inverse() @ updates[40].pose @ LASER.inverse()
    assert math.hypot(off.x, off.y) < 0.1
    tracking.restart()
    assert not tracking.results
    tracking.close()


@pytest.mark.skipif(sys.platform != 'linux', reason='elsewhere the niceness is that of the process')
def test_the_odometry_goes_before_the_map_on_one_processor():
    own, tracking = os.getpriority(os.PRIO_PROCESS, 0), Tracking(Parameters(), builds=True)
    assert tracking.read(lambda: os.getpriority(os.PRIO_PROCESS, 0)).result() == min(own + NICENESS, 19)
    assert os.getpriority(os.PRIO_PROCESS, 0) == own
    tracking.close()


def test_an_error_is_kept_until_a_step_succeeds(updates, monkeypatch):
    tracking = Tracking(Parameters(), builds=True)
    with monkeypatch.context() as broken:
        broken.setattr(tracking._mapper, 'process', lambda update: 1 / 0)
        tracking.process(updates[0], LASER)
        assert tracking.draw().result() is None
        assert tracking.fault == 'ZeroDivisionError: division by zero' and not tracking.results
    tracking.process(updates[0], LASER)
    tracking.draw().result()
    assert tracking.fault == '' and tracking.waiting == 0 and len(tracking.results) == 1
    tracking.close()
