# SPDX-License-Identifier: Apache-2.0
"""Wheels and gyroscope together, without DDS."""
import math
from types import SimpleNamespace

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu

from dbscan_reg_ros import SE2
from dbscan_reg_ros.core.geometry.mounting import Mounting
from dbscan_reg_ros.core.registration.records import Prior
from dbscan_reg_ros.node import priors
from dbscan_reg_ros.node.interfaces.messages import pose_to_message, stamp_to_message
from dbscan_reg_ros.robot.parameters import NodeParameters

START, END = 10**12, 10**12 + 10**8
PREDICTED = Prior(SE2(0.08, 0.0, 0.05), np.diag((0.01, 0.01, 0.02)) ** 2)


@pytest.fixture
def source(monkeypatch):
    """``source(wheels, rate)``: the prior of a scan, and what is said; a motion of the wheels, and a rate [rad/s]."""
    def source(wheels, rate, orientation=None, measured=True, publishers=1):
        told, said = {}, []

        def subscription(_node, topic, callback):
            told[topic.name] = callback
            return SimpleNamespace(topic_name=f'/{topic.name}')

        monkeypatch.setattr(priors, 'subscription', subscription)
        node = SimpleNamespace(count_publishers=lambda _: publishers)
        found = priors.Priors(node, NodeParameters().replace({'prior.source': 'odometry+imu'}), None,
                              SimpleNamespace(warn=said.append), lambda: None)
        for stamp, pose in ((START, SE2(1.0, 2.0, 0.3)), (END, SE2(1.0, 2.0, 0.3) @ (wheels or SE2()))):
            if wheels:
                message = Odometry()
                message.header.stamp, message.pose.pose = stamp_to_message(stamp), pose_to_message(pose)
                if orientation is not None:
                    message.pose.pose.orientation.z = message.pose.pose.orientation.w = orientation
                told['wheel_odom'](message)
            if rate is not None:
                message = Imu()
                message.header.stamp, message.angular_velocity.z = stamp_to_message(stamp), rate
                message.angular_velocity_covariance[0] = 0.0 if measured else -1.0
                told['imu'](message)
        found.processed(START, Mounting())
        return found.find('laser', END, Mounting(), lambda _: PREDICTED), said
    return source


def test_the_wheels_give_the_translation_and_the_gyroscope_the_rotation(source):
    found, said = source(SE2(0.1, 0.0, 0.4), 2.0)
    assert said == []
    # The chord of the wheels' arc points to half of their rotation too much.
    assert found.transform.as_array() == pytest.approx([0.1 * np.cos(-0.1), 0.1 * np.sin(-0.1), 0.2], abs=1e-6)
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx([0.04, 0.04, 0.04], rel=1e-6)


def test_without_one_of_them_the_other_is_used_and_the_missing_one_is_named(source):
    found, said = source(SE2(0.1, 0.0, 0.4), None)
    assert found.transform.as_array() == pytest.approx([0.1, 0.0, 0.4])
    assert len(said) == 1 and '/imu has no data' in said[0]
    found, said = source(None, 2.0)
    assert found.transform.theta == pytest.approx(0.2)
    assert np.hypot(found.transform.x, found.transform.y) == pytest.approx(0.08)
    assert len(said) == 1 and '/wheel_odom has no data' in said[0]


def test_without_both_the_motion_model_predicts(source):
    found, said = source(None, None)
    assert found is None
    assert len(said) == 1 and 'the constant-velocity prediction' in said[0]


def test_messages_that_cannot_be_are_named_and_not_believed(source):
    broken = SE2(0.1, 0.0, 0.4)
    found, said = source(broken, math.nan, orientation=0.0)
    assert found is None
    assert '/wheel_odom: the quaternion' in said[0] and '/imu: angular_velocity.z is nan' in said[1]
    found, said = source(None, 2.0, measured=False)
    assert found is None and '/imu: angular_velocity_covariance begins with -1' in said[0]


def test_a_source_without_a_publisher_is_named(source):
    assert 'no node publishes on /wheel_odom' in source(None, None, publishers=0)[1][0]
