# SPDX-License-Identifier: Apache-2.0
"""ICP, IDC and ICL on simulated scans with exact truth."""
import math

import numpy as np
import pytest

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.core.scan import Scan
from dbscan_reg_ros.core.scan_geometry import ScanGeometry
from dbscan_reg_ros.evaluation.baselines import fit, icl, icp, idc
from dbscan_reg_ros.simulation import Lidar, measure, rooms

BASELINES = {'icp': icp, 'idc': idc, 'icl': icl}


def views(motion, seed=0):
    """Two scans in a furnished room, the second after `motion`."""
    first = SE2(2.6, 3.0, 0.4)
    rng = np.random.default_rng(seed)
    lidar = Lidar(beams=360, angle_min=-math.pi, noise=0.005)
    return [measure(rooms(1), [pose.as_array()], lidar, rng) for pose in (first, first @ motion)]


def register(method, reference, current, guess=SE2()):
    return method.align(method.prepare(reference), method.prepare(current), guess)


def error(truth, result):
    difference = truth.inverse() @ result.transform
    return math.hypot(difference.x, difference.y), math.degrees(abs(difference.theta))


def test_the_fit_of_paired_points_is_their_motion():
    points = np.random.default_rng(0).normal(size=(50, 2))
    truth = SE2(0.3, -2.0, 2.5)
    assert np.allclose(fit(truth.apply(points), points).as_array(), truth.as_array(), atol=1e-12)


@pytest.mark.parametrize('method', BASELINES.values(), ids=BASELINES)
def test_a_small_motion_is_found(method):
    truth = SE2(0.12, -0.05, 0.06)
    result = register(method, *views(truth))
    metres, degrees = error(truth, result)
    assert result.status is Status.OK
    assert metres < 0.03 and degrees < 0.6


@pytest.mark.parametrize('method', BASELINES.values(), ids=BASELINES)
def test_a_guess_is_where_the_search_starts(method):
    truth = SE2(0.12, -0.05, 2.5)
    metres, degrees = error(truth, register(method, *views(truth), guess=SE2(0.05, 0.0, 2.45)))
    assert metres < 0.03 and degrees < 0.6


def test_icl_fails_without_lines():
    empty = Scan(0, np.full(180, np.inf), ScanGeometry(-math.pi / 2, math.pi / 180, 180))
    scan, _ = views(SE2())
    assert register(icl, scan, empty).status is Status.FAILED
    assert register(icl, empty, scan).status is Status.FAILED
