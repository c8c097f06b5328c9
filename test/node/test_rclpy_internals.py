# SPDX-License-Identifier: Apache-2.0
"""The node with what it uses of the inside of rclpy, and on a version of rclpy that has none of it."""
import os

import pytest
from ros_helpers import TIMEOUT, Loudspeaker, distances, transform

from dbscan_reg_ros import SE2

WITHOUT = """
from dbscan_reg_ros.node import rclpy_internals
rclpy_internals.CAN_TAKE = rclpy_internals.CAN_WAIT = False
rclpy_internals.NO_PUBLISHER_EVENTS = rclpy_internals.NO_SUBSCRIPTION_EVENTS = None
"""


@pytest.fixture(params=['with', 'without'])
def inside(request, tmp_path, ros_environment):
    """The environment of a node with the inside of rclpy, or without."""
    from dbscan_reg_ros.node import rclpy_internals
    assert rclpy_internals.CAN_TAKE and rclpy_internals.CAN_WAIT
    if request.param == 'with':
        return {}
    folder = tmp_path / 'without'
    folder.mkdir()
    (folder / 'sitecustomize.py').write_text(WITHOUT)
    return {'PYTHONPATH': os.pathsep.join([str(folder), os.environ['PYTHONPATH']])}


def test_scans_wait_for_their_transforms_and_give_the_pose_of_the_base(start_command, player, peer,
                                                                       scans_and_truth, tf_type, inside):
    """The base stands still on the spot where the sensor starts; the laser drives away on it."""
    scans, truth = scans_and_truth
    node = start_command('scan_matcher', '--ros-args', '-p', 'advanced.input.max_wait:=10.0', **inside)
    player.wait_for_node(TIMEOUT)
    moving = Loudspeaker(peer, tf_type, '/tf')
    places = [transform('base_link', 'laser', p, stamp=s.stamp) for s, p in zip(scans[:40], truth, strict=False)]
    moving.until(lambda: not player.play(scans[:1], patience=0.2).lost, tf_type(transforms=places[:1]))
    assert player.play(scans[1:2], patience=0.5).lost == 1
    with peer.spinning():
        moving.publisher.publish(tf_type(transforms=places))
        assert player.play(scans[2:3], patience=5.0).unexpected == 1
    answers = player.play(scans[3:40])
    assert answers.lost == 0
    assert distances(answers.messages, [SE2()] * 37).max() < 0.05
    assert node.stop() == 0 and 'Traceback' not in node.output()
