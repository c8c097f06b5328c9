# SPDX-License-Identifier: Apache-2.0
"""Two small isolated objects give the whole motion: scans of a wood are registered without a prior."""
import dataclasses
import math

import numpy as np
import pytest
from benchmarks.odometry.course import simulated
from benchmarks.odometry.places import wood

from dbscan_reg_ros import SE2, Parameters, Prior
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.features.poles import find_small_objects
from dbscan_reg_ros.core.registration.landmarks import landmark_motions
from dbscan_reg_ros.core.registration.pipeline import register
from dbscan_reg_ros.core.registration.problem import SearchStage
from dbscan_reg_ros.core.scan import Scan
from dbscan_reg_ros.core.scan_geometry import ScanGeometry
from dbscan_reg_ros.recordings.poses import compose
from dbscan_reg_ros.simulation import LIDARS
from dbscan_reg_ros.simulation.raycasting import cast

PARAMETERS = Parameters()
ALL_AROUND = ScanGeometry(-math.pi, math.radians(0.5), 720)
NO_WALLS = np.empty((0, 2, 2))


@pytest.fixture(scope='module')
def drive():
    world = wood(0)
    return simulated(dataclasses.replace(world, tour=world.tour[:3]), LIDARS['rplidar_a'], seed=0)


def seen(circles, pose, walls=NO_WALLS):
    """Features of what a lidar at a pose ``(3,)`` measures of round things ``(T, 3)`` [m]."""
    directions = np.exp(1j * (ALL_AROUND.bearings + pose[2]))
    ranges = cast(pose[None, :2], np.column_stack((directions.real, directions.imag)), walls, circles)
    ranges[ranges > 12.0] = np.inf
    return extract_features(Scan(0, ranges, ALL_AROUND), PARAMETERS)


def apart(motion, truth):
    """Translation [m] and rotation [rad] of a motion from the true one."""
    off = motion - truth
    return math.hypot(off[0], off[1]), abs(math.remainder(off[2], 2.0 * math.pi))


def test_landmarks_are_small_isolated_objects():
    trunks = np.array([(3.0, 0.0, 0.1), (0.0, 5.0, 0.3), (-4.0, 0.2, 0.3), (-7.5, 0.0, 2.0), (0.0, -3.0, 0.8)])
    things = find_small_objects(seen(trunks, np.zeros(3)), 1.0, PARAMETERS.segments)
    found = things.middle[np.argsort(things.nearest)]
    assert found == pytest.approx([3.0, -4.0 + 0.2j, 5.0j],
                                  abs=0.03), 'in front of a large one, too; a large one is none'


@pytest.mark.parametrize('seed', range(3))
def test_the_motion_between_two_scans_of_trunks_is_among_the_hypotheses_however_it_turned(seed):
    rng = np.random.default_rng(seed)
    trunks = np.column_stack((rng.uniform(-9.0, 9.0, (12, 2)), rng.uniform(0.05, 0.3, 12)))
    trunks = trunks[np.hypot(trunks[:, 0], trunks[:, 1]) > 1.5]
    start, motion = np.array((0.0, 0.0, rng.uniform(-3.0, 3.0))), np.array((*rng.uniform(-0.7, 0.7, 2),
                                                                            rng.uniform(-3.1, 3.1)))
    reference, current = seen(trunks, start), seen(trunks, compose(start[None], motion[None])[0])
    best, *others = landmark_motions(reference, current, PARAMETERS)
    way, turn = apart(best, motion)
    assert way < 0.1 and turn < math.radians(2.0)
    assert all(math.hypot(*(other - best)[:2]) > 0.2 or abs(math.remainder(other[2] - best[2], 2.0 * math.pi)) > 0.1
               for other in others), 'hypotheses that are one'


def test_motions_that_a_prior_rules_out_are_none():
    trunks = np.array([(3.0, 0.0, 0.1), (0.0, 5.0, 0.3), (-4.0, 0.2, 0.3), (0.0, -3.0, 0.2)])
    reference, current = seen(trunks, np.zeros(3)), seen(trunks, np.array((0.3, 0.1, 0.2)))
    def motions(x, y, theta, spread=0.05):
        prior = Prior(SE2(x, y, theta), np.diag((spread, spread, spread)) ** 2)
        return landmark_motions(reference, current, PARAMETERS, prior)
    assert apart(motions(0.3, 0.1, 0.2)[0], (0.3, 0.1, 0.2)) == pytest.approx((0.0, 0.0), abs=0.03)
    assert not len(motions(0.3, 0.1, 0.6)) and not len(motions(-0.3, 0.1, 0.2))
    assert len(motions(-0.3, 0.1, 0.6, spread=0.5))


@pytest.mark.parametrize('here', [0, 1], ids=['none', 'one'])
@pytest.mark.parametrize('turned', [False, True])
def test_one_landmark_tells_no_motion(here, turned):
    trunks, wall = np.array([(2.0, 1.0, 0.2), (3.0, -1.0, 0.2),
                             (-2.0, 0.5, 0.3)]), np.array([[(-5.0, 4.0), (5.0, 4.0)]])
    scans = [seen(circles, np.zeros(3), wall) for circles in (trunks[:here], trunks)]
    assert landmark_motions(*(scans[::-1] if turned else scans), PARAMETERS).shape == (0, 3)


def test_landmarks_belong_to_the_wide_search_and_are_off_where_that_is_off(drive):
    narrow = PARAMETERS.replace({'advanced.selection.wide_search_factor': 1})
    without = narrow.replace({'advanced.selection.max_landmarks': 0})
    differ = 0
    for first in range(0, 400, 40):
        pair = [extract_features(drive.scans[each], PARAMETERS) for each in (first, first + 30)]
        found = [register(*pair, parameters) for parameters in (narrow, without)]
        np.testing.assert_array_equal(*(each.transform.as_array() for each in found))
        wide = [register(*pair, each, first_stage=SearchStage.WIDE) for each in (narrow, without)]
        differ += wide[0].score > wide[1].score + 0.02
    assert differ >= 1
