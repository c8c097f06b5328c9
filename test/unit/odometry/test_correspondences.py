# SPDX-License-Identifier: Apache-2.0
"""Correspondences of a scan with the key frames of the window, and the alignment to them."""

import numpy as np
import pytest
from l_room import DENSITY, END, START, features
from rooms import look

from dbscan_reg_ros import SE2, Parameters
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.features.oriented_points import OrientedPoints
from dbscan_reg_ros.core.mapping.correspondences import align, weighted_by_agreement
from dbscan_reg_ros.core.mapping.key_frame import KeyFrame
from dbscan_reg_ros.core.mapping.key_frame_window import KeyFrameWindow
from dbscan_reg_ros.core.mapping.lookup import look_up_correspondences
from dbscan_reg_ros.core.mapping.records import PosePrior
from dbscan_reg_ros.core.sensor import Sensor

PARAMETERS = Parameters()


def equations(found):
    """The normal equations (4, 4) of the pairs, without a step."""
    return found.rows * found.match(found.pose, 0.1)[1] @ found.rows.T


NO_PRIOR = PosePrior(SE2(), np.zeros((3, 3)))


def window(*poses):
    return KeyFrameWindow([KeyFrame(features(pose), pose) for pose in poses])


def test_a_point_on_several_key_frames_counts_once():
    current = features(END)
    one, two = (equations(look_up_correspondences(window(*[START] * count), END, current.sampled_points, DENSITY))
                for count in (1, 3))
    assert one[0, 0] + one[1, 1] > 0.99 * len(current.sampled_points)
    np.testing.assert_allclose(two[:3, :3], one[:3, :3], rtol=0.01, atol=0.1)


def test_key_frames_are_looked_up_each_in_its_own_likelihood_field():
    """Each sees a part of the room only; together they find the scan."""
    poses = SE2(3.5, 0.0, 0.2), SE2(-1.5, 2.6, -1.0), START
    near = END @ SE2(0.04, -0.03, 0.03)
    correspondences = look_up_correspondences(window(*poses), near, features(END).oriented_points, DENSITY)
    found = align(correspondences, near, NO_PRIOR, [0.2, 0.1, 0.05, 0.05], 1e-6)
    assert (END.inverse() @ found).as_array() == pytest.approx(np.zeros(3), abs=3e-3)


def test_correspondences_end_with_the_wall_of_the_key_frame():
    """Without this limit the last line of the wall would extend to points beyond its end, and bias them."""
    short, longer = (extract_features(look(np.array([[(-2.0, -1.0), (end, -1.0)]]))) for end in (1.0, 1.3))
    points = longer.oriented_points
    correspondences = look_up_correspondences(KeyFrameWindow([KeyFrame(short, SE2())]), SE2(), points, DENSITY)
    x, last = longer.oriented_points.points.real, short.oriented_points.points.real.max()
    assert x.max() > 1.25 and last > 0.95
    found = np.bincount(correspondences.index, minlength=len(x)) > 0
    beyond = x > last + 2.0 * DENSITY.cell_size
    assert found[x < last].all() and not found[beyond].any() and beyond.sum() > 3


def no_correspondences(pose):
    points = OrientedPoints(np.array([50.0 + 50.0j]), np.array([-1j]), np.array([0]))
    return look_up_correspondences(window(SE2()), pose, points, DENSITY)


def test_without_correspondences_the_pose_is_that_of_the_prior():
    """The angle wraps: from 3.1 rad to -3.1 rad it is 0.083 rad."""
    pose, expected = SE2(29.0, 1.0, 3.1), SE2(30.0, -1.0, -3.1)
    root = np.array([[2.0, 0.0, 0.0], [1.0, 3.0, 0.0], [0.5, -1.0, 4.0]])
    found = align(no_correspondences(pose), pose, PosePrior(expected, root @ root.T), [0.1], 0.0)
    assert found.as_array() == pytest.approx(expected.as_array())


WALLS = [[(-2.0, -1.0), (2.0, -1.0)], [(-2.0, 1.5), (2.0, 1.5)]]


def seen_up_to(x, count=3, **sensor):
    """Key frames of a lidar in a corridor of 2.5 m by 4 m that ends at a cabinet, which the lidar sees at `x` [m]."""
    ends = [] if x is None else [[(x, -1.0), (x, 1.5)]]
    return [KeyFrame(extract_features(look(np.array(WALLS + ends)), PARAMETERS), SE2(), **sensor)] * count


def among_two_lidars(own_x, other_x):
    """Points of a scan at the origin, its pairs with key frames of two lidars, and the same weighted by agreement."""
    window = KeyFrameWindow([*seen_up_to(own_x), *seen_up_to(other_x, sensor=Sensor('other'))])
    points, own = seen_up_to(2.0, 1)[0].features.oriented_points, window.of_sensor('')
    found, weighted, of_own = (look_up_correspondences(each, SE2(), points, DENSITY) for each in (window, window, own))
    weighted_by_agreement(weighted, of_own, window.is_in(own), 0.05, 0.01)
    return points, found, weighted


def test_what_two_lidars_see_differently_does_not_displace_the_scan():
    """The other lidar sees the plinth of the cabinet, 4 cm behind its front; both see the same walls."""
    points, found, weighted = among_two_lidars(2.0, 2.04)
    at_end, of_other = np.abs(points.normals.real).take(found.index) > 0.7, found.frame >= 3
    assert np.count_nonzero(at_end & of_other) > 100
    assert (weighted.weights[at_end & of_other] < 1e-3).all()
    assert (weighted.weights[~of_other] == 1.0).all() and np.median(weighted.weights[~at_end & of_other]) > 0.999
    displaced, right = (align(each, SE2(), NO_PRIOR, [0.05], 1e-6).x for each in (found, weighted))
    assert displaced > 0.01 and abs(right) < 1e-4


def test_pairs_have_their_full_weight_where_the_own_lidar_has_none():
    points, found, weighted = among_two_lidars(None, 2.02)
    at_end = np.abs(points.normals.real).take(found.index) > 0.7
    assert np.count_nonzero(at_end) > 100 and (found.frame[at_end] >= 3).all()
    assert weighted.weights[at_end] == pytest.approx(1.0, abs=1e-3)
