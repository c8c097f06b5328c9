# SPDX-License-Identifier: Apache-2.0
"""The node with a map: its names, and a map that is given later; without DDS."""
import time

import pytest
import rclpy  # noqa: F401 - needs ROS
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from ros_helpers import TIMEOUT

from dbscan_reg_ros import SE2, ParameterError
from dbscan_reg_ros.node.interfaces.messages import pose_to_message


@pytest.fixture
def with_map(start_core):
    """``with_map(**parameters)``: a core that ends its thread."""
    robots = []

    def with_map(**parameters):
        robots.append(start_core(**parameters))
        return robots[-1]

    yield with_map
    for robot in robots:
        robot.core.close()


def names(node):
    return ({each.topic_name for each in (*node.publishers, *node.subscriptions)}
            | {each.srv_name for each in node.services})


def until(robot, text):
    """Let time pass until the log has `text`; the map is read in a thread."""
    end = time.perf_counter() + TIMEOUT
    while text not in robot.log:
        assert time.perf_counter() < end, robot.log
        robot.node.wait(0.1)


def test_all_that_a_mode_adds_is_gone_with_the_core(start_core):
    without = names(start_core().node)
    for mode, own in (('slam', {'/map', '/map_state', '/map_graph', '/pose', '/scan_matcher/save_map'}),
                      ('localize', {'/map', '/map_state', '/pose', '/initialpose',
                                    'reinitialize_global_localization'})):
        robot = start_core(map__mode=mode)
        assert names(robot.node) - without - {'/tf'} == own
        robot.core.deactivate()
        assert '/scan' not in names(robot.node) and '/odom' in names(robot.node)
        robot.core.close()
        assert not names(robot.node) and not robot.node.timers


def test_a_map_can_be_given_later_and_its_lack_is_named(with_map, tmp_path):
    robot = with_map(map__mode='localize')
    assert [message.data for message in robot.sent('/map_state')] == ['waiting for a map']
    robot.node.wait(4.0)
    assert 'no map is received' not in robot.log
    robot.node.wait(2.0)
    assert 'no map is received on /map: start a map server, or set map.file' in robot.log
    robot.set(map__file=str(tmp_path / 'missing.npz'))
    until(robot, 'the map before is kept')
    (tmp_path / 'map.pgm').write_bytes(b'P5 40 20 255\n' + bytes(400) + bytes([254]) * 400)
    (tmp_path / 'map.yaml').write_text('{image: map.pgm, resolution: 0.1, origin: [0, 0, 0], negate: 0, '
                                       'occupied_thresh: 0.65, free_thresh: 0.25}')
    robot.set(map__file=str(tmp_path / 'map.yaml'))
    until(robot, 'map of 40 x 20 cells of 0.1 m: searching')
    said = len(robot.node.said)
    robot.node.wait(20.0)
    assert not any('no map is received' in text for text in robot.node.said[said:])


def test_what_cannot_be_a_map_or_a_pose_in_it_is_named(with_map):
    robot = with_map(map__mode='localize')
    robot.receive('/map', OccupancyGrid())
    assert '/map is ignored: 0 x 0 cells with 0 values; expected as many values as cells' in robot.log
    given = PoseWithCovarianceStamped()
    given.header.frame_id, given.pose.pose = 'odom', pose_to_message(SE2())
    robot.receive('/initialpose', given)
    assert "initialpose is ignored: the pose is in 'odom'; expected 'map'" in robot.log


def test_a_map_that_cannot_be_read_is_refused_at_the_start(start_core):
    with pytest.raises(ParameterError, match=r"^map.file = 'missing.npz': "):
        start_core(map__mode='localize', map__file='missing.npz')
    robot = start_core(map__file='missing.npz')
    assert "map.file = 'missing.npz' has no effect: map.mode is none; set it to localize or slam" in robot.log
