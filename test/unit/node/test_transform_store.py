# SPDX-License-Identifier: Apache-2.0
"""Transforms by frames and times."""
import importlib.util
import math

import numpy as np
import pytest
import rclpy  # noqa: F401 - needs ROS
from ros_helpers import transform as transform_at

from dbscan_reg_ros import SE2
from dbscan_reg_ros.node.errors import NoTransformError
from dbscan_reg_ros.node.frames.transform_store import Tf2Store, TransformStore

SECOND = 1_000_000_000


def transform(parent, child, x=0.0, y=0.0, yaw=0.0, **more):
    return transform_at(parent, child, SE2(x, y, yaw), **more)


@pytest.fixture(params=[TransformStore, pytest.param(Tf2Store, marks=pytest.mark.skipif(
    importlib.util.find_spec('tf2_ros') is None, reason='needs tf2_ros, part of a ROS installation'))])
def store(request):
    return request.param()


def test_static_transforms_are_composed_along_the_tree(store):
    store.add(transform('base', 'mast', x=0.2, yaw=math.pi / 2.0), static=True)
    store.add(transform('mast', 'laser', x=0.1), static=True)
    store.add(transform('base', 'camera', y=-1.0), static=True)
    matrix, known = store.lookup('base', 'laser', 5 * SECOND)
    assert known
    assert matrix[:3, 3] == pytest.approx([0.2, 0.1, 0.0])
    assert matrix[:3, 0] == pytest.approx([0.0, 1.0, 0.0])
    matrix, _ = store.lookup('camera', 'laser', 0)
    assert matrix[:3, 3] == pytest.approx([0.2, 1.1, 0.0])
    back, _ = store.lookup('laser', 'camera', 0)
    assert back @ matrix == pytest.approx(np.eye(4))


def test_moving_transforms_are_interpolated_and_held_outside_their_time(store):
    store.add(transform('base', 'laser', x=1.0, yaw=3.0, stamp=10 * SECOND), static=False)
    store.add(transform('base', 'laser', x=2.0, yaw=-3.0, stamp=11 * SECOND), static=False)
    matrix, known = store.lookup('base', 'laser', 10 * SECOND + SECOND // 2)
    assert known
    assert matrix[0, 3] == pytest.approx(1.5)
    assert abs(math.atan2(matrix[1, 0], matrix[0, 0])) == pytest.approx(math.pi)
    matrix, known = store.lookup('base', 'laser', 12 * SECOND)
    assert not known
    assert matrix[0, 3] == pytest.approx(2.0)


def test_a_moving_frame_above_both_does_not_matter(store):
    store.add(transform('odom', 'base', x=7.0, stamp=10 * SECOND), static=False)
    store.add(transform('base', 'laser', x=1.0), static=True)
    matrix, known = store.lookup('base', 'laser', 99 * SECOND)
    assert known
    assert matrix[0, 3] == pytest.approx(1.0)


def test_a_stray_transform_does_not_take_the_place_of_a_static_one(store):
    store.add(transform('base', 'laser', x=1.0), static=True)
    store.add(transform('elsewhere', 'laser', x=9.0, stamp=10 * SECOND), static=False)
    for stamp in (9, 10, 11, 99):
        matrix, known = store.lookup('base', 'laser', stamp * SECOND)
        assert known and matrix[0, 3] == pytest.approx(1.0)


def test_a_moving_transform_that_goes_on_counts_before_a_static_one(store):
    store.add(transform('base', 'laser', x=1.0), static=True)
    for k in range(11):
        store.add(transform('base', 'laser', x=2.0 + 0.1 * k, stamp=10 * SECOND + k * SECOND // 10), static=False)
    matrix, known = store.lookup('base', 'laser', 10 * SECOND + SECOND // 2)
    assert known and matrix[0, 3] == pytest.approx(2.5)


def test_after_strays_the_static_transform_counts_again():
    store = TransformStore()
    store.add(transform('base', 'laser', x=1.0), static=True)
    for k in range(2):
        store.add(transform('elsewhere', 'laser', x=9.0, stamp=(10 + k) * SECOND), static=False)
    with pytest.raises(NoTransformError):
        store.lookup('base', 'laser', 12 * SECOND)
    matrix, known = store.lookup('base', 'laser', 17 * SECOND)
    assert known and matrix[0, 3] == pytest.approx(1.0)


def test_frames_that_are_not_connected_are_named(store):
    store.add(transform('base', 'mast'), static=True)
    with pytest.raises(NoTransformError, match='laser'):
        store.lookup('base', 'laser', 0)


def test_restarted_stamps_clear_moving_transforms_and_a_late_stamp_does_not(store):
    store.add(transform('base', 'mast', x=5.0), static=True)
    for stamp in (100, 101, 92):
        store.add(transform('mast', 'laser', x=float(stamp), stamp=stamp * SECOND), static=False)
        store.add(transform('mast', 'camera', stamp=stamp * SECOND), static=False)
    matrix, known = store.lookup('base', 'laser', 96 * SECOND)
    assert known
    assert matrix[0, 3] == pytest.approx(101.0)
    for stamp in (89, 90):
        store.add(transform('mast', 'laser', x=float(stamp), stamp=stamp * SECOND), static=False)
    matrix, known = store.lookup('base', 'laser', 89 * SECOND + SECOND // 2)
    assert known
    assert matrix[0, 3] == pytest.approx(94.5)
    assert not store.lookup('base', 'laser', 96 * SECOND)[1]
    with pytest.raises(NoTransformError):
        store.lookup('base', 'camera', 101 * SECOND)


def test_transforms_without_a_rotation_are_passed_over():
    store = TransformStore()
    broken = transform('base', 'laser')
    broken.transform.rotation.w = 0.0
    store.add(broken, static=True)
    with pytest.raises(NoTransformError):
        store.lookup('base', 'laser', 0)


def test_a_loop_of_frames_ends():
    store = TransformStore()
    store.add(transform('a', 'b'), static=True)
    store.add(transform('b', 'a'), static=True)
    with pytest.raises(NoTransformError):
        store.lookup('c', 'a', 0)


def test_the_past_is_forgotten():
    store = TransformStore()
    for k in range(1000):
        store.add(transform('base', 'laser', stamp=k * SECOND), static=False)
    assert len(store._moving['laser']._stamps) <= 22
