# SPDX-License-Identifier: Apache-2.0
"""Rigid motions against their matrices."""
import itertools
import math

import numpy as np
import pytest

from dbscan_reg_ros.core.errors import ArgumentError
from dbscan_reg_ros.core.geometry.se2 import SE2, wrap


def matrix(motion):
    result = np.eye(3)
    result[:2, :2], result[:2, 2] = motion.rotation(), (motion.x, motion.y)
    return result


def drawn(count=50):
    rng = np.random.default_rng(0)
    return [SE2(*rng.uniform(-5.0, 5.0, 2), rng.uniform(-math.pi, math.pi)) for _ in range(count)]


def test_composition_and_inverse_are_those_of_the_matrices():
    motions = drawn()
    for a, b in itertools.pairwise(motions):
        np.testing.assert_allclose(matrix(a @ b), matrix(a) @ matrix(b), atol=1e-12)
        np.testing.assert_allclose(matrix(a.inverse()), np.linalg.inv(matrix(a)), atol=1e-12)
        assert -math.pi <= (a @ b).theta < math.pi


def test_points_move_as_the_paper_says():
    """Eq. 8: rotate, then translate."""
    motion = SE2(-1.5, 0.8, 0.3)
    points = np.random.default_rng(1).uniform(-5.0, 5.0, (4, 7, 2))
    moved = motion.apply(points)
    assert moved.shape == points.shape
    c, s = math.cos(0.3), math.sin(0.3)
    np.testing.assert_allclose(moved[..., 0], c * points[..., 0] - s * points[..., 1] - 1.5)
    np.testing.assert_allclose(moved[..., 1], s * points[..., 0] + c * points[..., 1] + 0.8)
    np.testing.assert_allclose(motion.inverse().apply(moved), points, atol=1e-12)
    np.testing.assert_allclose(SE2().apply([1.0, 2.0]), [1.0, 2.0])


@pytest.mark.parametrize('angle, expected', [
    (0.0, 0.0), (math.pi, -math.pi), (-math.pi, -math.pi), (3.5, 3.5 - 2.0 * math.pi), (-7.0, -7.0 + 2.0 * math.pi),
    (1e6, 1e6 - 159155 * 2.0 * math.pi),
])
def test_angles_are_wrapped_to_minus_pi_included_and_pi_excluded(angle, expected):
    assert wrap(angle) == pytest.approx(expected, abs=1e-9)
    assert wrap(np.array([angle]))[0] == wrap(angle)


def test_the_adjoint_carries_a_body_perturbation_across_a_motion():
    """``exp(d) @ b == b @ exp(Ad(b^-1) d)`` to first order."""
    for motion in drawn(20):
        small = 1e-6 * np.array([1.0, -2.0, 0.5])
        left = SE2.from_array(small) @ motion
        right = motion @ SE2.from_array(motion.inverse().adjoint() @ small)
        np.testing.assert_allclose(left.as_array(), right.as_array(), atol=1e-10)


def test_motions_become_numbers_arrays_and_matrices_and_come_back():
    for motion in drawn():
        x, y, theta = motion
        assert (x, y, theta) == (motion.x, motion.y, motion.theta)
        np.testing.assert_array_equal(np.asarray(motion), [x, y, theta])
        np.testing.assert_array_equal(motion.as_matrix(), matrix(motion))
        assert SE2.from_array(motion) == motion
        np.testing.assert_allclose(SE2.from_matrix(motion.as_matrix()), motion, atol=1e-15)
        np.testing.assert_allclose(SE2.from_matrix(motion.as_matrix().astype(np.float32)), motion, atol=1e-5)
    assert np.array(drawn()).shape == (50, 3)


@pytest.mark.parametrize('numbers', [(math.nan, 0.0, 0.0), (0.0, math.inf, 0.0), (0.0, 0.0, -math.inf)])
def test_numbers_that_are_not_finite_are_no_motion(numbers):
    for make in (lambda: SE2(*numbers), lambda: SE2.from_array(numbers)):
        with pytest.raises(ArgumentError, match='expected finite numbers'):
            make()


@pytest.mark.parametrize(('wrong', 'words'), [
    (np.eye(4), r'shape \(4, 4\): expected \(3, 3\)'), (2.0 * np.eye(3), 'is 1 away from that of a rotation'),
    (np.diag((1.0, -1.0, 1.0)), 'is 2 away'), (matrix(SE2(1.0, 2.0)).T, 'is 2 away')])
def test_a_matrix_that_is_no_motion_is_refused(wrong, words):
    with pytest.raises(ArgumentError, match=words):
        SE2.from_matrix(wrong)


def test_an_array_does_not_multiply_the_numbers_of_a_motion():
    for multiply in (lambda: np.eye(3) @ SE2(), lambda: np.ones(3) * SE2(), lambda: np.ones(3) + SE2()):
        with pytest.raises(TypeError):
            multiply()
