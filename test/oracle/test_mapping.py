# SPDX-License-Identifier: Apache-2.0
"""Compiled steps of the map against their definitions: pair by pair, by finite differences, and as matrices."""
import cmath
import math
from types import SimpleNamespace

import numpy as np
import pytest
from compiled_inputs import oriented_points

from dbscan_reg_ros.core.features.oriented_points import OrientedPoints
from dbscan_reg_ros.core.features.tables import build_likelihood_field
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.mapping.correspondences import align, weighted_by_agreement
from dbscan_reg_ros.core.mapping.dynamic_points import beside, detached_points, dynamic_points, information_ratio
from dbscan_reg_ros.core.mapping.local_map import older_map_points
from dbscan_reg_ros.core.mapping.lookup import Slots, confirm, look_up_correspondences, look_up_subsets
from dbscan_reg_ros.core.mapping.records import PosePrior
from dbscan_reg_ros.core.odometry.models.propagation import CovariancePropagation
from dbscan_reg_ros.core.parameters.registration import MIN_NORMAL_COSINE
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.core.registration.records import Prior

P = Parameters()
SEEDS = pytest.mark.parametrize('seed', range(3))


def window(rng, count, size=150):
    """Key frames near the origin, as far as points are looked up in them."""
    poses = [SE2(*rng.normal(0.0, 0.2, 3).tolist()) for _ in range(count)]
    return window_of([key_frame(pose, build_likelihood_field(oriented_points(rng, size), P.density)) for pose in poses])


def key_frame(pose, field, nearby=(0.0,)):
    free_space = SimpleNamespace(nearby=np.array(nearby))
    return SimpleNamespace(pose=pose, features=SimpleNamespace(likelihood_field=field, free_space=free_space))


def window_of(frames):
    return SimpleNamespace(frames=frames, slots=Slots(frames))


def pairs_of(window, pose, points):
    """(frame, point, error) of all pairs, one by one."""
    found = []
    for k, frame in enumerate(window.frames):
        field, relative = frame.features.likelihood_field, frame.pose.inverse() @ pose
        turn, shift = cmath.rect(1.0, relative.theta), complex(relative.x, relative.y)
        for p in range(len(points)):
            place, normal = turn * points.points[p] + shift, turn * points.normals[p]
            at = int(field.nearest(np.array([place]))[0])
            offset = field.normals[at] * place
            if (at < len(field.normals) - 1 and (field.normals[at] * normal).real > MIN_NORMAL_COSINE
                    and abs(offset.imag - field.along[at]) <= field.extents[at]):
                found.append((k, p, offset.real - field.offsets[at]))
    return found


@SEEDS
@pytest.mark.parametrize('count', [1, 4])
def test_pairs_are_the_nearest_lines_of_each_key_frame(seed, count):
    rng = np.random.default_rng(seed)
    frames, points, pose = window(rng, count), oriented_points(rng, 180), SE2(*rng.normal(0.0, 0.1, 3).tolist())
    found, expected = look_up_correspondences(frames, pose, points, P.density), pairs_of(frames, pose, points)
    order = np.lexsort((found.index, found.frame))
    assert len(expected) > 10
    assert list(zip(found.frame[order].tolist(), found.index[order].tolist(), strict=True)) == [
        pair[:2] for pair in expected]
    np.testing.assert_allclose(found.rows[3, order], [error for *_, error in expected], atol=1e-12)
    # The Jacobian: finite differences of the error.
    step = 1e-6
    for axis, moved in enumerate((SE2(pose.x + step, pose.y, pose.theta), SE2(pose.x, pose.y + step, pose.theta),
                                  SE2(pose.x, pose.y, pose.theta + step))):
        jacobian = found.rows[axis, order]
        after = {pair[:2]: pair[2] for pair in pairs_of(frames, moved, points)}
        both = [i for i, pair in enumerate(expected) if pair[:2] in after]
        slope = [(after[expected[i][:2]] - expected[i][2]) / step for i in both]
        steady = np.abs(np.array(slope)) < 100.0  # elsewhere another line is the nearest
        np.testing.assert_allclose(jacobian[both][steady], np.array(slope)[steady], atol=1e-3)


@SEEDS
def test_a_point_is_confirmed_by_the_best_key_frame_from_elsewhere(seed):
    rng = np.random.default_rng(seed)
    frames = window(rng, 4)
    points, pose, scale = oriented_points(rng, 180), SE2(0.02, -0.01, 0.01), 0.05
    found = confirm(frames, pose, points, 0.15, scale, P.density)
    expected = np.zeros(180)
    for k, p, error in pairs_of(frames, pose, points):
        if math.hypot(frames.frames[k].pose.x - pose.x, frames.frames[k].pose.y - pose.y) > 0.15:
            expected[p] = max(expected[p], math.exp(-0.5 * (error / scale) ** 2))
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert 0 < np.count_nonzero(expected) < 180


@SEEDS
@pytest.mark.parametrize('frames', [1, 7, 40])
def test_every_point_is_looked_up_in_several_key_frames_and_subsets_follow_the_beams(seed, frames):
    rng = np.random.default_rng(seed)
    always, beams = rng.uniform(size=500) < 0.1, np.sort(rng.choice(2000, 500, replace=False))
    found = look_up_subsets(always, beams, frames, 60)
    count = max(min(frames // 3, -(-np.count_nonzero(~always) // 60)), 1)
    assert len(found) == count
    seen = np.zeros((count, 500), dtype=bool)
    np.put_along_axis(seen, found, True, axis=1)
    assert seen[:, always].all()
    for k in range(count):
        np.testing.assert_array_equal(seen[k, ~always], beams[~always] % count == k)


def weighted_points(rng):
    """180 points with weights of their own."""
    points = oriented_points(rng, 180)
    return OrientedPoints(points.points, points.normals, points.beams, rng.uniform(0.2, 1.0, 180))


@SEEDS
def test_the_alignment_is_the_damped_least_squares_of_each_iteration(seed):
    rng = np.random.default_rng(seed)
    found = look_up_correspondences(window(rng, 2), SE2(0.1, -0.2, 0.3), weighted_points(rng), P.density)
    start = SE2(0.11, -0.19, 0.31)
    information = np.diag(rng.uniform(0.1, 5.0, 3))
    prior, damping = PosePrior(SE2(0.13, -0.22, 0.29), information), 0.003
    offset = np.subtract(start.as_tuple(), found.pose.as_tuple())
    for scale in (0.05, 0.01):
        _, weight = found.match(SE2(*np.add(found.pose.as_tuple(), offset)), scale)
        jacobian, error = found.rows[:3], found.rows[3]
        square = jacobian * weight @ jacobian.T + information
        gradient = jacobian * weight @ error + information @ np.subtract(found.pose.as_tuple(), prior.pose.as_tuple())
        offset = -np.linalg.solve(square + damping * (square[0, 0] + square[1, 1] + 1e-6) * np.eye(3), gradient)
    aligned = align(found, start, prior, [0.05, 0.01], damping)
    np.testing.assert_allclose(np.subtract(aligned.as_tuple(), found.pose.as_tuple()), offset, atol=1e-12)


@SEEDS
def test_kernels_are_the_exponential_to_2e_12_and_end_at_that_of_64(seed):
    rng = np.random.default_rng(seed)
    found = look_up_correspondences(window(rng, 1), SE2(), weighted_points(rng), P.density)
    _, given = found.match(SE2(), 1e9)
    for scale in np.geomspace(1e-4, 10.0, 40):
        errors, weight = found.match(SE2(), scale)
        exponent = np.maximum(-0.5 * (errors / scale) ** 2, -64.0)
        np.testing.assert_allclose(weight, given * np.exp(exponent), rtol=2.1e-12, atol=0.0)


@SEEDS
def test_pairs_of_other_lidars_are_weighted_by_how_far_their_means_differ(seed):
    rng = np.random.default_rng(seed)
    frames, points, here, there = window(rng, 2), weighted_points(rng), SE2(0.01, 0.02, 0.01), SE2(0.0, 0.01, 0.0)
    found, own = (look_up_correspondences(each, pose, points, P.density)
                  for each, pose in ((frames, here), (window_of(frames.frames[:1]), there)))
    is_own, scale, noise, given = np.array([True, False]), 0.05, 0.01, found.weights
    offset = np.append(np.subtract(here.as_tuple(), there.as_tuple()), 1.0)
    weighted_by_agreement(found, own, is_own, scale, noise)
    weights = found.weights
    assert (weights < 0.9 * given).any()
    for k in range(len(weights)):
        if is_own[found.frame[k]]:
            assert weights[k] == given[k]
            continue
        means = []
        for error, chosen in ((found.rows[3], ~is_own[found.frame] & (found.index == found.index[k])),
                              (offset @ own.rows, own.index == found.index[k])):
            error = error[chosen]
            kernel = np.exp(-0.5 * (error / scale) ** 2)
            means.append((max(kernel.sum(), 1e-9), (kernel * error).sum() / max(kernel.sum(), 1e-9)))
        (one, first), (other, second) = means
        sigma = noise * math.sqrt(1.0 / one + 1.0 / other)
        expected = given[k] * math.exp(-0.5 * ((first - second) / sigma) ** 2)
        assert weights[k] == pytest.approx(expected, abs=1e-12)


@SEEDS
def test_points_in_free_space_are_dynamic_and_so_is_a_run_of_which_many_are(seed):
    rng = np.random.default_rng(seed)
    points, pose, margin, bins = oriented_points(rng, 300), SE2(0.1, 0.05, 0.2), 0.3, 360
    inside = (np.arange(300) >= 100) & (np.arange(300) < 130)
    points.points[inside] *= 0.6
    nearby = rng.normal(4.3, 0.1, bins)
    field = build_likelihood_field(points, P.density)
    free = window_of([key_frame(SE2(0.05, 0.02, 0.1), field, nearby)])
    at = cmath.rect(1.0, -0.1) * (cmath.rect(1.0, 0.2) * points.points + (0.1 + 0.05j) - (0.05 + 0.02j))
    number = np.minimum(((np.angle(at) + math.pi) * bins / (2.0 * math.pi)).astype(int), bins - 1)
    in_free_space = nearby[number] - np.abs(at) > margin
    run = np.concatenate(([0], np.cumsum(np.abs(np.diff(points.points)) > margin)))
    expected = in_free_space | (np.array([in_free_space[run == r].mean() for r in run]) > 0.3)
    assert expected.mean() < 0.4 and expected[inside].all()
    np.testing.assert_array_equal(dynamic_points(points, pose, free, 1, margin, np.ones(300, dtype=bool)), expected)
    near, dynamic = np.zeros(300, dtype=bool), expected.nonzero()[0]
    for k in range(300):
        sides = (*dynamic[dynamic <= k][-1:], *dynamic[dynamic >= k][:1])
        near[k] = any(abs(points.points[i] - points.points[k]) <= margin for i in sides)
    np.testing.assert_array_equal(beside(points, expected, margin), near)


@SEEDS
@pytest.mark.parametrize('closed', [False, True])
def test_small_objects_with_space_on_both_sides_are_detached(seed, closed):
    rng = np.random.default_rng(seed)
    points, size, margin = oriented_points(rng, 240), 0.8, 0.3
    for first in (0, 60, 61, 150, 236):
        points.points[first:first + 4] *= 0.5
    own, radius = points.points, np.abs(points.points)
    cut = [k for k in range(240) if abs(own[k] - own[k - 1]) > margin and (k or closed)]
    groups = ([list(range(a, b)) for a, b in zip(cut, [*cut[1:], cut[0] + 240], strict=True)] if closed
              else [list(range(a, b)) for a, b in zip([0, *cut], [*cut, 240], strict=True)])
    expected = np.zeros(240)
    for group in groups:
        index = [k % 240 for k in group]
        sides = [radius[(index[0] - 1) % 240] if closed or index[0] else math.inf,
                 radius[(index[-1] + 1) % 240] if closed or index[-1] < 239 else math.inf]
        extent = abs(complex(np.ptp(own[index].real), np.ptp(own[index].imag)))
        expected[index] = len(index) * (extent < size and sides[0] > radius[index[0]] + margin
                                        and sides[1] > radius[index[-1]] + margin)
    assert 0 < np.count_nonzero(expected) < 40
    np.testing.assert_array_equal(detached_points(points, size, margin, closed), expected)


@SEEDS
def test_the_ratio_of_information_is_the_largest_generalised_eigenvalue(seed):
    rng = np.random.default_rng(seed)
    points = oriented_points(rng, 100)
    chosen = np.sort(rng.permutation(100)[:20])
    rows = np.stack((points.normals.real, points.normals.imag))
    values = np.linalg.eigvals(np.linalg.solve(rows @ rows.T, rows[:, chosen] @ rows[:, chosen].T))
    assert information_ratio(points, chosen) == pytest.approx(values.real.max())


@SEEDS
def test_the_newest_points_of_a_cell_stay_unless_the_latest_key_frame_has_one(seed):
    rng = np.random.default_rng(seed)
    scattered = [OrientedPoints(rng.normal(0.0, 0.15, (60, 2)) @ (1.0, 1j), np.full(60, 1j), np.arange(60))
                 for _ in range(6)]
    free_space = SimpleNamespace(near=np.zeros(60))
    *older, latest = (SimpleNamespace(pose=SE2(), features=SimpleNamespace(
        sampled_points=points, oriented_points=points, free_space=free_space)) for points in scattered)
    found = older_map_points(older, latest, P.density)
    side = P.density.cell_size
    cells = [[(round(p.real / side), round(p.imag / side)) for p in points.points] for points in scattered]
    farthest = np.abs(np.concatenate([points.points for points in scattered])).max()
    expected = [p for k, points in enumerate(scattered[:5]) for p, cell in zip(points.points, cells[k], strict=True)
                if not any(cell in newer for newer in cells[k + 1:]) and abs(p) <= farthest]
    np.testing.assert_array_equal(found.points, expected)
    assert 20 < len(expected) < 250


@SEEDS
@pytest.mark.parametrize('interval, by_motion_model', [(0.1, True), (0.1, False), (0.0, True)])
def test_errors_of_pose_and_twist_are_propagated_as_a_linear_system(seed, interval, by_motion_model):
    """The error of a step is that of the prediction or of the match, by the gain; a match sees the key frame's."""
    rng = np.random.default_rng(seed)

    def covariance(size, scale):
        root = rng.normal(0.0, scale, (size, size))
        return root @ root.T

    joint, change, rest = covariance(9, 0.01), covariance(3, 0.002), covariance(3, 0.002)
    prior = Prior(SE2(), change + rest, change if by_motion_model else None)
    gain, measured, step = rng.normal(0.4, 0.1, (3, 3)), covariance(3, 0.002), SE2(0.2, 0.05, 0.3)
    back, zero, one = step.inverse().adjoint(), np.zeros((3, 3)), np.eye(3)
    rate = 1.0 / interval if interval else 0.0
    spread = change if by_motion_model else change + rest
    fading = np.diag(np.sqrt(np.maximum(1.0 - rate ** 2 * np.diag(spread), 0.0))) if by_motion_model else zero
    # Columns: pose, pose since the key frame, twist; change of the twist, rest of the prediction, match.
    effect = np.block([zero, -gain @ back, interval * (one - gain) @ fading, one - gain, one - gain, gain])
    transition = np.vstack((effect, effect, rate * effect))
    transition[:3, :3] += back
    transition[3:6, 3:6] += back
    transition[6:, 12:15] = 0.0
    errors = np.zeros((18, 18))
    errors[:9, :9], errors[9:12, 9:12], errors[15:, 15:] = joint, spread, measured
    errors[12:15, 12:15] = change + rest - spread
    propagation = CovariancePropagation(joint)
    propagation.propagate(step, interval, prior, gain, measured)
    expected = transition @ errors @ transition.T
    if interval:
        assert expected[6:, 6:].trace() < 1.0  # a larger one would be bounded
    else:
        expected[6:], expected[:, 6:], expected[6:, 6:] = 0.0, 0.0, one
    np.testing.assert_allclose(propagation.joint, expected, rtol=1e-9, atol=1e-12)
