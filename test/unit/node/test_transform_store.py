# SPDX-License-Identifier: Apache-2.0
"""Transforms by frames and times."""
import math

import numpy as np
import pytest
from rclpy.time import Time
from ros_helpers import transform as transform_at

from dbscan_reg_ros import SE2
from dbscan_reg_ros.node.frames.transform_store import NoTransformError, TransformStore
from dbscan_reg_ros.recordings.poses import matrix_of, pose_of_transform

SECOND = 1_000_000_000


def transform(parent, child, x=0.0, y=0.0, yaw=0.0, **more):
    return transform_at(parent, child, SE2(x, y, yaw), **more)


@pytest.fixture
def store():
    return TransformStore()


@pytest.mark.parametrize('seed', range(3))
def test_the_same_transforms_are_found_as_by_tf2_ros(store, seed):
    """A tree of ten frames, each static or moving; at, between and outside the stamps of the moving ones."""
    tf2_ros = pytest.importorskip('tf2_ros', reason='needs tf2_ros, part of a ROS installation')
    rng, buffer = np.random.default_rng(seed), tf2_ros.Buffer()
    for frame in range(1, 10):
        static, parent = bool(rng.integers(2)), f'f{rng.integers(frame)}'
        for stamp in [0] if static else np.sort(rng.integers(100 * SECOND, 105 * SECOND, 20)).tolist():
            message = transform(parent, f'f{frame}', *rng.uniform(-3.0, 3.0, 3), stamp=stamp)
            store.add(message, static)
            (buffer.set_transform_static if static else buffer.set_transform)(message, 'test')
    for stamp in rng.integers(99 * SECOND, 106 * SECOND, 200).tolist():
        target, source = (f'f{k}' for k in rng.integers(10, size=2))
        matrix, known = store.lookup(target, source, stamp)
        try:
            found = buffer.lookup_transform(target, source, Time(nanoseconds=stamp))
        except tf2_ros.ExtrapolationException:
            assert not known
        else:
            assert known
            assert matrix == pytest.approx(matrix_of(*pose_of_transform(found.transform)), abs=1e-9)


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
    matrix, _ = store.lookup('base', 'laser', 10 * SECOND + SECOND // 4)
    assert math.atan2(matrix[1, 0], matrix[0, 0]) == pytest.approx(3.0 + 0.25 * (2.0 * math.pi - 6.0))
    matrix, known = store.lookup('base', 'laser', 12 * SECOND)
    assert not known
    assert matrix[0, 3] == pytest.approx(2.0)


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


def test_after_strays_the_static_transform_counts_again(store):
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


def test_transforms_without_a_rotation_are_passed_over(store):
    broken = transform('base', 'laser')
    broken.transform.rotation.w = 0.0
    store.add(broken, static=True)
    with pytest.raises(NoTransformError):
        store.lookup('base', 'laser', 0)


def test_the_past_is_forgotten(store):
    for k in range(1000):
        store.add(transform('base', 'laser', stamp=k * SECOND), static=False)
    assert len(store._moving['laser']._stamps) <= 22
