# SPDX-License-Identifier: Apache-2.0
"""Lidars with names, and their parameters."""
import pytest

from dbscan_reg_ros import Odometry, ScanError
from dbscan_reg_ros.core.geometry.mounting import Mounting
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.parameters.features import ScanParameters
from dbscan_reg_ros.core.sensor import Sensor
from dbscan_reg_ros.robot.parameter_files import read_parameters, write_parameters
from dbscan_reg_ros.robot.parameters import NodeParameters, mounting_from_parameters
from dbscan_reg_ros.robot.sensors import INHERITED

MASK = [0.5, 1.0, *[0.0] * 6]


def named(**values):
    """Parameters of the lidars front and rear; two underlines in a name stand for the dot."""
    return NodeParameters().replace({'sensors': ['front', 'rear'],
                                     **{name.replace('__', '.'): value for name, value in values.items()}})


def test_both_forms_give_the_same_lidars():
    short = NodeParameters().replace({'scan_topics': ['front/scan', 'back'], 'input.mask': [0.0] * 8 + MASK,
                                      'input.time_offset': [0.0, -0.06], 'scan.range_max': 9.0})
    long = named(rear__topic='back', rear__mask=MASK, rear__time_offset=[-0.06], scan__range_max=9.0)
    assert long.scan_topics == short.scan_topics
    assert [long.lidar(topic) for topic in long.scan_topics] == [short.lidar(topic) for topic in short.scan_topics]


def test_what_is_not_given_is_inherited():
    parameters = named(input__mask=MASK, scan__noise_min=0.01, scan__range_max=20.0, rear__range_max=5.0,
                       rear__mask=[0.0] * 8, front__type='sensor_msgs/PointCloud2', input__height_max=2.0)
    front, rear = (parameters.lidar(topic) for topic in ('/front/scan', 'rear/scan'))
    assert (front.input.mask, rear.input.mask) == (tuple(MASK), (0.0,) * 8)
    assert (front.scan.range_max, rear.scan.range_max) == (20.0, 5.0)
    assert front.scan.noise_min == rear.scan.noise_min == 0.01
    assert (front.input.type, rear.input.type, front.input.height_max) == ('sensor_msgs/PointCloud2', 'auto', 2.0)
    # A change of the plain parameter reaches those who do not have their own.
    changed = parameters.replace({'scan.range_max': 15.0, 'rear.noise_min': 0.02})
    assert [changed.lidar(topic).scan.range_max for topic in changed.scan_topics] == [15.0, 5.0]
    assert [changed.lidar(topic).scan.noise_min for topic in changed.scan_topics] == [0.01, 0.02]


def test_a_pose_that_is_given_is_used():
    parameters = named(front__laser_pose=[0.3, 0.2, 0.5], front__upside_down=True, rear__mounting='tf')
    front, rear = (mounting_from_parameters(parameters.lidar(topic)) for topic in parameters.scan_topics)
    assert front == Mounting(SE2(0.3, 0.2, 0.5), upside_down=True) and rear is None


def test_a_single_lidar_may_have_a_name():
    parameters = NodeParameters().replace({'sensors': ['front'], 'front.range_max': 7.0})
    assert parameters.for_odometry().scan.range_max == 7.0
    assert named(front__range_max=7.0).for_odometry().scan.range_max == 0.0
    plain = NodeParameters()
    assert plain.for_odometry() is plain


def test_a_parameter_file_holds_the_parameters_of_each_lidar(tmp_path):
    parameters = named(front__laser_pose=[0.3, 0.2, 0.5], rear__laser_pose=[0.0, 0.0, 3.0], rear__mask=MASK)
    write_parameters(tmp_path / 'all.yaml', parameters)
    read = read_parameters(tmp_path / 'all.yaml')
    assert read.flatten() == parameters.flatten()
    assert {f'rear.{own}' for own in ('topic', *INHERITED)} <= read.flatten().keys()
    (tmp_path / 'own.yaml').write_text('/**: {ros__parameters: {sensors: [front, rear], front: {topic: a}, '
                                       'rear: {range_min: 1}}}')
    own = read_parameters(tmp_path / 'own.yaml')
    assert own.scan_topics == ('a', 'rear/scan') and own.lidar('rear/scan').scan.range_min == 1.0


@pytest.mark.parametrize('values, expected', [
    ({'scan_topics': ['x']}, r"scan_topics = \['x'\] with sensors = \['front', 'rear'\], whose topics are"),
    ({'front.tpoic': 'x'}, r"unknown parameter 'front.tpoic'; did you mean 'front.topic'"),
    ({'top.topic': 'x'}, r"unknown parameter 'top.topic': 'top' is no lidar in sensors = \['front', 'rear'\]"),
    ({'front.topic': 'x', 'rear.topic': 'x'}, 'expected each topic once'),
    ({'sensors': ['front', 'front']}, 'expected each name once'),
    ({'sensors': ['input']}, "not 'input'"), ({'sensors': ['front', 'a.b']}, "not 'a.b'"),
    ({'sensors': 'front'}, 'expected a list of one or more texts'),
    ({'mounting': 'none'}, "front.mounting = 'none' without front.laser_pose: expected the pose"),
    ({'front.mask': MASK * 2}, 'front.mask = .*: expected 8 numbers$'),
    ({'input.mask': MASK * 2}, 'input.mask = .*: expected 8 numbers$'),
    ({'front.range_min': -1.0}, 'front.range_min = -1.0: expected 0.0 to 1000.0 m'),
    ({'rear.type': 'scan'}, "rear.type = 'scan': expected one of 'auto'"),
    ({'rear.upside_down': 1}, 'rear.upside_down = 1: expected true or false'),
    ({'calibrate_mountings': True}, 'calibrate_mountings is gone')])
def test_contradictions_are_named(values, expected):
    with pytest.raises(ValueError, match=expected):
        NodeParameters().replace({'sensors': ['front', 'rear'], **values})


@pytest.mark.parametrize('values, expected', [
    ({'mounting': 'none'}, "expected mounting 'tf' for several lidars"),
    ({'scan_topics': ['a', 'a']}, 'expected each topic once'),
    ({'input.time_offset': [0.0, 0.1, 0.2]}, 'expected one number, or 2: 1 for each topic of scan_topics')])
def test_lidars_without_names_that_cannot_be_used_are_refused(values, expected):
    with pytest.raises(ValueError, match=expected):
        NodeParameters().replace({'scan_topics': ['a', 'b'], **values})


def test_parameters_of_lidars_without_names_are_unknown():
    with pytest.raises(ValueError, match=r"unknown parameter 'front\.topic': 'front' is no lidar in sensors"):
        NodeParameters().replace({'front.topic': 'x'})


def test_each_sensor_has_its_own_limits(scans):
    near = Sensor('near', limits=ScanParameters(range_max=3.0, noise_min=0.03))
    odometry, all_returns = Odometry(), Odometry().process(scans[0]).features
    limited = odometry.process(scans[0], None, near).features
    assert 0 < len(limited.points) < len(all_returns.points)
    assert (limited.points**2).sum(axis=1).max() < 3.0**2 < (all_returns.points**2).sum(axis=1).max()
    assert limited.noise >= 0.03 > all_returns.noise
    # Parameters that are replaced do not bring old limits back.
    odometry.parameters = odometry.parameters.replace({'advanced.scan.min_returns': 400})
    with pytest.raises(ScanError):
        odometry.process(scans[1], None, Sensor('near', limits=ScanParameters(range_max=3.0, min_returns=400)))
