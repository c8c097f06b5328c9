# SPDX-License-Identifier: Apache-2.0
"""The running node under bad input: scans with every field at its worst, parameters with every wrong type and value."""
import array
import math

import numpy as np
import rclpy  # noqa: F401 - needs ROS
from child import most_memory
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from ros_helpers import Loudspeaker, Parameters, diagnosis, played
from sensor_msgs.msg import LaserScan
from worst_scans import worst_scan

from dbscan_reg_ros import ParameterError
from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.node.interfaces.messages import scan_to_message
from dbscan_reg_ros.robot.parameters import NodeParameters

MEMORY = 512 * 2**20
BURST = 20
"""Scans at a time: fewer than the node's queue holds."""


def filled(fields) -> LaserScan:
    """The message with the fields of a worst scan, as far as one can hold them."""
    message = LaserScan()
    stamp = fields.header.stamp
    message.header.stamp.sec, message.header.stamp.nanosec = stamp.sec, stamp.nanosec
    message.header.frame_id = fields.header.frame_id.replace('\0', '')
    for name in ('ranges', 'intensities'):
        setattr(message, name, array.array('f', np.asarray(getattr(fields, name), np.float32).tobytes()))
    for name in ('angle_min', 'angle_max', 'angle_increment', 'time_increment', 'scan_time', 'range_min', 'range_max'):
        setattr(message, name, getattr(fields, name))
    return message


def count(status, name):
    return int(next(value.value for value in status.values if value.key == name))


def test_scans_with_every_field_at_its_worst_are_answered_or_skipped_and_counted(start_node, peer, scans, size):
    node = start_node('-p', 'advanced.input.queue_size:=50')
    total = size(400, 20_000)
    answers = peer.listen(Odometry, 'odom')
    received = peer.listen(DiagnosticArray, '/diagnostics')
    speaker = Loudspeaker(peer, LaserScan, 'scan')
    good = scan_to_message(scans[0])
    speaker.until(lambda: answers, good)
    for burst in range(total // BURST):
        rng = np.random.default_rng(burst)
        for index in range(BURST):
            speaker.publisher.publish(filled(worst_scan(rng, index, huge=0.01)))
        good.header.stamp.sec += 10
        stamp = in_nanoseconds(good.header.stamp)
        speaker.until(lambda stamp=stamp: any(in_nanoseconds(m.header.stamp) == stamp for m in answers), good)
        for message in answers:
            pose, twist = message.pose, message.twist
            assert np.isfinite([pose.pose.position.x, pose.pose.position.y, twist.twist.linear.x,
                                twist.twist.angular.z]).all()
            for covariance in (pose.covariance, twist.covariance):
                assert np.isfinite(covariance).all()
                assert np.linalg.eigvalsh(np.reshape(covariance, (6, 6)))[0] > 0.0
        answers.clear()
    status = diagnosis(peer, received, lambda s: count(s, 'scans received') >= total)
    assert count(status, 'scans processed') + count(status, 'scans skipped') + count(status, 'scans dropped') == count(
        status, 'scans received')
    assert count(status, 'scans skipped') > total // 4 and count(status, 'scans processed') > total // 4
    assert node.running() and 'Traceback' not in node.output()
    assert most_memory(node.pid) < MEMORY


WRONG = [None, True, False, -2**63, -1, 0, 1, 2**63 - 1, math.nan, math.inf, -math.inf, -1.0, 1e-320, 1e308, '', 'x',
         '../../etc/passwd',
         '/', 'ü\n{}%s', 10**5 * 'x', [b'\0', b'\xff'], [True], [], [0], [1, 2, 3], [0] * 8, [2**63 - 1] * 3,
         [math.nan] * 3,
         [math.inf] * 8, [0.0] * 7, [0.0] * 1000, ['a', 'b', 'c'], ['']]
TYPES = {type(None): 'NOT_SET', bool: 'BOOL', int: 'INTEGER', float: 'DOUBLE', str: 'STRING', bytes: 'BYTE'}


def value_message(value) -> ParameterValue:
    """`value` as the message of a parameter, of any type that there is."""
    if isinstance(value, list):
        kind = f'{TYPES[type(value[0])] if value else "DOUBLE"}_ARRAY'
    else:
        kind = TYPES[type(value)]
    message = ParameterValue(type=getattr(ParameterType, f'PARAMETER_{kind}'))
    if value is not None:
        setattr(message, f'{kind.lower()}_value', value)
    return message


def is_wrong(description, value):
    """Whether a running node has to refuse the value."""
    if description.read_only:
        return True
    if isinstance(value, list) and len(value) == len(np.ravel(description.default)):
        value = [float(v) if type(v) is int else v for v in value]
    try:
        NodeParameters().replace({description.name: value})
    except ParameterError:
        return True
    return False


def test_parameters_of_every_wrong_type_and_value_are_refused_and_change_nothing(node, player, peer, scans, size):
    names = Parameters(peer).names()
    before = peer.call(GetParameters, '/scan_matcher/get_parameters', GetParameters.Request(names=names)).values
    step = size(4, 1)
    wrong = [(d.name, value) for number, d in enumerate(NodeParameters.describe())
             for value in WRONG[number % step::step]
             if is_wrong(d, value)]
    assert len(wrong) > 20 // step * len(NodeParameters.describe())
    for first in range(0, len(wrong), 200):
        some = wrong[first:first + 200]
        request = SetParameters.Request(parameters=[
            ParameterMessage(name=name, value=value_message(value)) for name, value in some])
        results = peer.call(SetParameters, '/scan_matcher/set_parameters', request).results
        assert [case for case, result in zip(some, results, strict=True) if result.successful
                or not result.reason] == []
    after = peer.call(GetParameters, '/scan_matcher/get_parameters', GetParameters.Request(names=names)).values
    assert after == before
    answers = played(player, scans[:20])
    assert answers.lost == 0
    assert 'Traceback' not in node.output()


def test_names_that_are_no_parameters_are_refused(node, peer):
    Parameters(peer).names()
    names = ['', '.', 'scan', 'scan.', 'scan.range_max.x', 'ü', 'x' * 1000, '__class__', 'qos_overrides', 'a\nb']
    for name in names:
        request = SetParameters.Request(parameters=[ParameterMessage(name=name, value=value_message(1.0))])
        [result] = peer.call(SetParameters, '/scan_matcher/set_parameters', request).results
        assert not result.successful and result.reason
