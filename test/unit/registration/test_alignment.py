# SPDX-License-Identifier: Apache-2.0
"""Point-to-line equations of one scan with another, and with all key frames of the window."""
import dataclasses
import math

import numpy as np
import pytest
from rooms import FULL, L_ROOM, look, outline

from dbscan_reg_ros import SE2, Parameters
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.features.likelihood_field import build_likelihood_field
from dbscan_reg_ros.core.features.oriented_points import OrientedPoints, high_leverage
from dbscan_reg_ros.core.geometry.symmetric_matrix import solve
from dbscan_reg_ros.core.odometry.mapping.correspondences import PosePrior, align
from dbscan_reg_ros.core.odometry.mapping.key_frame import KeyFrame
from dbscan_reg_ros.core.odometry.mapping.key_frame_window import KeyFrameWindow
from dbscan_reg_ros.core.registration.point_to_line import (
    NO_STEP,
    Alignment,
    fit,
    jacobian,
    mean_square,
    normal_equations,
    polish,
    refine,
    shared_information,
)

PARAMETERS = Parameters()
DENSITY = PARAMETERS.density
NO_PRIOR = PosePrior(SE2(), np.zeros((3, 3)))
START, END = SE2(-0.6, 0.3, 0.3), SE2(-0.9, 0.1, -0.4)
MOTION = START.inverse() @ END
NEAR = MOTION @ SE2(0.03, -0.02, 0.015)


def features(pose):
    return extract_features(look(outline(L_ROOM), pose, FULL))


def rows(*motions):
    return np.array([motion.as_array() for motion in motions])


def fitted(reference, current, *motions):
    return fit(rows(*motions), current.sampled_points, reference.likelihood_field, DENSITY.min_normal_cosine)


def test_a_point_before_a_wall_errs_by_its_distance_and_weighs_by_the_kernel():
    """A wall at y = 2 m faces the sensor, another at y = -2 m; the point is at y = 1.9 m before it is moved."""
    x = np.arange(-1.0, 1.0, 0.01)
    surface = build_likelihood_field(OrientedPoints(np.concatenate((x + 2j, x - 2j)), np.repeat((-1j, 1j), 200), np.arange(400)), DENSITY)
    point = OrientedPoints(np.array([0.3 + 1.9j]), np.array([-1j]), np.array([0]))
    before, turned, far = np.array([0.0, 0.05, 0.0]), np.array([1.9, 1.65, 0.5 * math.pi]), np.array([0.0, -0.6, 0.0])
    found = fit(np.array([before, turned, far]), point, surface, 0.5)
    assert (found.error[0, 0], found.normals[0, 0], found.rotated_points[0, 0]) == pytest.approx((0.05, 1j, 0.3 + 1.9j))
    assert found.places[1, 0] == pytest.approx(1.9 + 1.65j + 1j * (0.3 + 1.9j))
    assert found.weight(0.1)[:, 0] == pytest.approx([math.exp(-0.125), 0.0, 0.0])


def test_the_equations_are_those_of_the_numeric_derivatives():
    reference, current = features(START), features(END)
    found = fitted(reference, current, NEAR, MOTION)
    error, weight = found.error[0], found.weight(0.1)[0]
    assert np.count_nonzero(weight) > 100
    step, columns = 1e-7, []
    for axis in range(3):
        moved = NEAR.as_array()
        moved[axis] += step
        columns.append((fitted(reference, current, SE2(*moved)).error[0] - error) / step)
    # Where a point comes into another cell, its partner may be another.
    smooth = np.abs(np.array(columns)).max(axis=0) < 10.0
    assert smooth.mean() > 0.98
    design = np.vstack((*columns, error))[:, smooth]
    expected = (design * weight[smooth]) @ design.T
    equations = normal_equations(found.rows()[..., smooth], found.weight(0.1)[:, smooth])
    assert equations.shape == (2, 4, 4)
    np.testing.assert_allclose(equations[0], expected, atol=1e-4)


def test_scans_with_the_same_normals_agree_on_all_information():
    reference, current = features(START), features(END)
    found = fitted(reference, current, NEAR)
    weight, same = found.weight(0.1)[0], jacobian(found.normals[0], found.rotated_points[0])
    np.testing.assert_allclose(
        shared_information(same, weight, same), normal_equations(found.rows()[0], weight)[:3, :3], atol=1e-9)


def test_scans_whose_normals_stray_each_by_itself_do_not_agree_along_a_wall():
    """Walls on both sides, along x; the normals are 0.2 rad off, as good as 160 points that hold x, in truth none."""
    rng = np.random.default_rng(0)
    size = 4000
    places = rng.uniform(-5.0, 5.0, size) + 1j * rng.choice((-1.0, 1.0), size)
    theirs, own = (-1j * np.sign(places.imag) * np.exp(1j * rng.normal(0.0, 0.2, size)) for _ in range(2))
    weight, theirs, own = np.ones(size), jacobian(theirs, places), jacobian(own, places)
    single, shared = normal_equations(theirs, weight)[0, 0], shared_information(theirs, weight, own)[0, 0]
    assert single == pytest.approx(0.04 * size, rel=0.1)
    # The sum of as many products of two independent normals of that spread: three standard deviations.
    assert abs(shared) < 3.0 * 0.04 * math.sqrt(size)


def test_a_damped_step_is_that_of_the_damped_matrix():
    equations = np.zeros((1, 4, 4))
    equations[0, :3, :3] = np.diag([4.0, 6.0, 9.0])
    equations[0, :3, 3] = 1.0, 2.0, 3.0
    assert solve(equations, 0.0)[0] == pytest.approx([1.0 / 4.0, 2.0 / 6.0, 3.0 / 9.0])
    assert solve(equations, 0.1)[0] == pytest.approx([1.0 / 5.0, 2.0 / 7.0, 3.0 / 10.0], rel=1e-6)
    assert solve(np.zeros((1, 4, 4)), 0.1)[0].tolist() == [0.0, 0.0, 0.0]


def test_the_mean_square_is_that_of_the_points_errors():
    """Three points with errors of 1, 2 and 3 m, of which the last weighs twice."""
    assert mean_square(np.array([1.0, 2.0, 3.0]), np.array([1.0, 1.0, 2.0])) == (1.0 + 4.0 + 2.0 * 9.0) / 4.0
    assert mean_square(np.ones(3), np.zeros(3)) == 0.0


def polished(reference, current, candidate):
    """The last iterations of a candidate ``(3,)``, over all points."""
    found = fit(candidate[None], current.oriented_points, reference.likelihood_field, DENSITY.min_normal_cosine)
    return polish(candidate, found, current.oriented_points, PARAMETERS.refinement)


def alignment(reference, current):
    return Alignment(current.sampled_points, reference.likelihood_field, DENSITY.min_normal_cosine, 1e-6)


def test_every_candidate_is_refined_to_the_motion():
    reference, current = features(START), features(END)
    near = rows(NEAR, MOTION @ SE2(-0.1, 0.08, -0.05))
    found, _ = refine(near, alignment(reference, current), [0.2, 0.2, 0.1, 0.05, 0.05])
    assert np.abs(found - MOTION.as_array()).max() < 2e-3
    assert np.abs(near[1] - MOTION.as_array()).max() > 0.04
    last, _ = polished(reference, current, found[0])
    assert np.abs(last - MOTION.as_array()).max() < 5e-4


def test_refining_from_a_known_fit_is_refining():
    reference, current = features(START), features(END)
    usual, known = (refine(rows(NEAR), alignment(reference, current), [0.1, 0.05], known)
                    for known in (None, fitted(reference, current, MOTION, NEAR).select([1])))
    np.testing.assert_array_equal(usual[0], known[0])
    np.testing.assert_array_equal(usual[1], known[1])


def test_a_candidate_that_would_creep_farther_than_the_kernel_stays():
    reference, current = features(START), features(END)
    near, far = ((MOTION @ SE2(share * PARAMETERS.refinement.final_scale, 0.0, 0.0)).as_array() for share in (0.8, 1.3))
    found, _ = polished(reference, current, near)
    assert np.abs(found - MOTION.as_array()).max() < 1e-3
    found, _ = polished(reference, current, far)
    assert (found == far).all()


def test_the_errors_of_what_was_polished_are_those_where_it_lies_now():
    reference, current = features(START), features(END)
    near = (MOTION @ SE2(0.02, -0.01, 0.01)).as_array()
    found, errors = polished(reference, current, near)
    there = fit(found[None], current.oriented_points, reference.likelihood_field, DENSITY.min_normal_cosine)
    both = errors.alike & there.alike
    assert both.mean() > 0.95
    assert np.percentile(np.abs(errors.error - there.error)[both], 95) < 3e-4
    assert np.median(np.abs(errors.error - fit(near[None], current.oriented_points, reference.likelihood_field, DENSITY.min_normal_cosine).error)[both]) > 3e-3
    few = errors.thinned(50)
    assert few.error.shape == (1, len(current.oriented_points.thinned(50)))
    np.testing.assert_array_equal(few.rotated_points[0], errors.rotated_points[0, ::8])


def plainly(reference, current, motion):
    """The equations of a registration, but for points beyond the ends of walls."""
    found, surface = fitted(reference, current, motion), reference.likelihood_field
    nearest = surface.nearest(found.places)
    beside = np.abs((found.normals * found.places).imag - surface.along[nearest])
    return normal_equations(found.rows(), found.weight(0.1) * (beside <= surface.extents[nearest]))[0]


def window(*poses):
    return KeyFrameWindow([KeyFrame(features(pose), pose) for pose in poses])


def test_one_key_frame_at_the_origin_gives_the_equations_of_a_registration():
    origin, current = SE2(), features(END)
    near = END @ SE2(0.03, -0.02, 0.015)
    plain = plainly(features(origin), current, near)
    found = window(origin).correspondences(near, current.sampled_points, DENSITY).equations(NO_STEP, 0.1)
    np.testing.assert_allclose(found, plain, atol=1e-9)


def test_equations_are_turned_into_the_odometry_frame():
    """Those of a registration to a key frame that is turned by half a right angle and stands elsewhere."""
    frame, current = SE2(-0.6, 0.3, 0.25 * math.pi), features(END)
    near = END @ SE2(0.03, -0.02, 0.015)
    inside = frame.inverse() @ near
    plain = plainly(features(frame), current, inside)
    turn = np.eye(4)
    turn[:2, :2] = frame.rotation()
    found = window(frame).correspondences(near, current.sampled_points, DENSITY).equations(NO_STEP, 0.1)
    np.testing.assert_allclose(found, turn @ plain @ turn.T, atol=1e-9)


def test_a_point_on_several_key_frames_counts_once():
    current = features(END)
    one, two = (window(*[START] * count).correspondences(END, current.sampled_points, DENSITY).equations(NO_STEP, 0.1) for count in (1, 3))
    assert one[0, 0] + one[1, 1] > 0.99 * len(current.sampled_points)
    np.testing.assert_allclose(two[:3, :3], one[:3, :3], rtol=0.01, atol=0.1)


def test_points_are_dealt_to_key_frames_when_there_are_many():
    """Nine times the same key frame: three hands of the points say together what all of them say to each.

    The few that face along the room are dealt to none: all key frames see them.
    """
    cloud = features(END).oriented_points
    along = np.abs(cloud.normals.real) > 0.7
    cloud = cloud.select(~along | (along.cumsum() % 5 == 0))
    others = (~high_leverage(cloud.normals)).nonzero()[0]
    cloud = cloud.select(np.delete(np.arange(len(cloud)), others[len(others) // 3 * 3:]))
    rare, size = high_leverage(cloud.normals), len(cloud)
    cloud = dataclasses.replace(cloud, beams=(~rare).cumsum())
    assert rare.any() and np.count_nonzero(~rare) % 3 == 0
    near, views = END @ SE2(0.03, -0.02, 0.015), window(*[START] * 9)
    whole, dealt = (views.correspondences(near, cloud, dataclasses.replace(DENSITY, max_points=points)) for points in (3 * size, size))
    expected = whole.equations(NO_STEP, 0.1)
    np.testing.assert_allclose(dealt.equations(NO_STEP, 0.1), expected, rtol=0.02, atol=0.02 * expected[2, 2])
    times, found = (np.bincount(correspondences.index, minlength=size) for correspondences in (whole, dealt))
    assert set(times) <= {0, 9} and np.array_equal(found[rare], times[rare])
    assert np.array_equal(3 * found[~rare], times[~rare])


def test_a_point_less_changes_the_partners_of_hardly_any_other():
    cloud, near = features(END).oriented_points, END @ SE2(0.03, -0.02, 0.015)
    views = window(*(START @ SE2(0.02 * k, 0.01 * k, 0.01 * k) for k in range(9)))
    density = dataclasses.replace(DENSITY, max_points=len(cloud))
    def lines(cloud):
        correspondences = views.correspondences(near, cloud, density)
        return set(zip(cloud.beams[correspondences.index].tolist(), correspondences.rows[3].tolist(), strict=True))
    left = np.arange(len(cloud)) != 20
    before, after = lines(cloud), lines(cloud.select(left))
    before = {line for line in before if line[0] != cloud.beams[20]}
    assert len(before ^ after) < 0.05 * len(before)


def test_key_frames_are_looked_up_each_in_its_own_surface():
    """Each sees a part of the room only; together they find the scan."""
    poses = SE2(3.5, 0.0, 0.2), SE2(-1.5, 2.6, -1.0), START
    near = END @ SE2(0.04, -0.03, 0.03)
    correspondences = window(*poses).correspondences(near, features(END).oriented_points, DENSITY)
    found = align(correspondences, near, NO_PRIOR, [0.2, 0.1, 0.05, 0.05], 1e-6)
    assert (END.inverse() @ found).as_array() == pytest.approx(np.zeros(3), abs=3e-3)


def test_a_wall_ends_where_a_key_frame_saw_it_end():
    """Its last line would go on for as far as points have partners, and noise of its normal would pull what lies beyond back."""
    short, longer = (extract_features(look(np.array([[(-2.0, -1.0), (end, -1.0)]]))) for end in (1.0, 1.3))
    correspondences = KeyFrameWindow([KeyFrame(short, SE2())]).correspondences(SE2(), longer.oriented_points, DENSITY)
    x, last = longer.oriented_points.points.real, short.oriented_points.points.real.max()
    assert x.max() > 1.25 and last > 0.95
    found = np.bincount(correspondences.index, minlength=len(x)) > 0
    beyond = x > last + 2.0 * DENSITY.cell_size
    assert found[x < last].all() and not found[beyond].any() and beyond.sum() > 3


def partners_of_nothing(pose):
    return window(SE2()).correspondences(pose, OrientedPoints(np.array([50.0 + 50.0j]), np.array([-1j]), np.array([0])), DENSITY)


def test_where_no_point_has_a_partner_the_prior_has_its_way():
    """The turn wraps: from 3.1 rad to -3.1 rad it is 0.083 rad."""
    pose, expected = SE2(29.0, 1.0, 3.1), SE2(30.0, -1.0, -3.1)
    root = np.array([[2.0, 0.0, 0.0], [1.0, 3.0, 0.0], [0.5, -1.0, 4.0]])
    found = align(partners_of_nothing(pose), pose, PosePrior(expected, root @ root.T), [0.1], 0.0)
    assert found.as_array() == pytest.approx(expected.as_array())


def test_damping_shortens_a_step_by_a_share_of_the_information_along_x_and_y():
    """A quarter of 2 + 2 is added to 2, 2 and 4."""
    pose = SE2(0.3, 0.0, 0.0)
    found = align(partners_of_nothing(pose), pose, PosePrior(SE2(0.0, 0.6, 0.5), np.diag([2.0, 2.0, 4.0])), [0.1], 0.25)
    assert found.as_array() == pytest.approx([0.1, 0.4, 0.4], abs=1e-6)


def test_a_step_from_where_partners_were_looked_for_moves_their_errors():
    """As at the place itself, to a tenth of a millimetre, and with the same weights."""
    current, views = features(END), window(START)
    near, step = END @ SE2(0.02, -0.02, 0.01), SE2(0.004, 0.003, 0.002)
    there = SE2(near.x + step.x, near.y + step.y, near.theta + step.theta)
    before, after = (views.correspondences(pose, current.oriented_points, DENSITY) for pose in (near, there))
    error, weight = before.match(before.step(there), 0.1)
    at, weight_at = after.match(NO_STEP, 0.1)
    both, one, two = np.intersect1d(before.index, after.index, return_indices=True)
    assert len(both) > 0.95 * len(current.oriented_points)
    same = np.abs(before.rows[:2, one] - after.rows[:2, two]).max(axis=0) < 1e-9
    assert same.mean() > 0.9
    np.testing.assert_allclose(error[one][same], at[two][same], atol=1e-4)
    np.testing.assert_allclose(weight[one][same], weight_at[two][same], atol=1e-3)


def test_iterations_may_go_on_where_others_ended():
    """Two and two more are four."""
    scales, near = [0.2, 0.1, 0.05, 0.05], END @ SE2(0.04, -0.03, 0.03)
    correspondences = window(START).correspondences(near, features(END).oriented_points, DENSITY)
    half = align(correspondences, near, NO_PRIOR, scales[:2], 1e-6)
    both, whole = (align(correspondences, start, NO_PRIOR, left, 1e-6) for start, left in ((half, scales[2:]), (near, scales)))
    assert both.as_array() == pytest.approx(whole.as_array(), abs=1e-12)


def test_points_move_with_the_scan_and_the_more_the_farther_they_are_when_it_turns():
    correspondences = window(START).correspondences(END, features(END).oriented_points, DENSITY)
    assert correspondences.mean_displacement(END) == 0.0
    assert correspondences.mean_displacement(SE2(END.x + 0.03, END.y - 0.04, END.theta)) == pytest.approx(0.05)
    reach = np.abs(correspondences.rotated_points).mean()
    assert correspondences.mean_displacement(SE2(END.x, END.y, END.theta + 0.01)) == pytest.approx(0.01 * reach, rel=1e-4)
    assert partners_of_nothing(END).mean_displacement(START) == 0.0


def test_a_window_drops_its_oldest_key_frames():
    frames = [KeyFrame(features(START), SE2(float(k), 0.0, 0.0)) for k in range(3)]
    grown = KeyFrameWindow(frames[:2]).with_frame(frames[2], 2)
    assert grown.frames == (frames[1], frames[2]) and grown.latest is frames[2]
