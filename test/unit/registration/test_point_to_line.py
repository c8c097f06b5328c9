# SPDX-License-Identifier: Apache-2.0
"""Point-to-line residuals, their normal equations and the refinement of candidates."""
import math

import numpy as np
import pytest
from l_room import (
    DENSITY,
    END,
    START,
    features,
    jacobian,
    linear_residuals,
    normal_equations,
    rows,
    table,
    weight,
)

from dbscan_reg_ros import SE2, Parameters
from dbscan_reg_ros.core.features.oriented_points import OrientedPoints
from dbscan_reg_ros.core.features.tables import build_likelihood_field
from dbscan_reg_ros.core.parameters.registration import FINAL_SCALE
from dbscan_reg_ros.core.registration.fit import fit, polish
from dbscan_reg_ros.core.registration.point_to_line import refine
from dbscan_reg_ros.core.registration.residuals import Alignment
from dbscan_reg_ros.core.registration.uncertainty import shared_information

PARAMETERS = Parameters()
MOTION = START.inverse() @ END
NEAR = MOTION @ SE2(0.03, -0.02, 0.015)


def test_a_point_before_a_wall_errs_by_its_distance_and_weighs_by_the_kernel():
    """A wall at y = 2 m faces the sensor, another at y = -2 m; the point is at y = 1.9 m before it is moved."""
    x = np.arange(-1.0, 1.0, 0.01)
    surface = build_likelihood_field(OrientedPoints(np.concatenate((x + 2j, x - 2j)), np.repeat((-1j, 1j), 200),
                                                    np.arange(400)), DENSITY)
    point = OrientedPoints(np.array([0.3 + 1.9j]), np.array([-1j]), np.array([0]))
    before, turned, far = np.array([0.0, 0.05, 0.0]), np.array([1.9, 1.65, 0.5 * math.pi]), np.array([0.0, -0.6, 0.0])
    found = [fit(each, point, surface) for each in (before, turned, far)]
    assert found[0].rotated_points[0] == pytest.approx(0.3 + 1.9j)
    assert linear_residuals(found[0])[:, 0] == pytest.approx((0.0, -1.0, -0.3, 0.05))
    assert found[1].places[0] == pytest.approx(1.9 + 1.65j + 1j * (0.3 + 1.9j))
    assert [weight(each, 0.1)[0] for each in found] == pytest.approx([math.exp(-0.125), 0.0, 0.0])


def test_scans_whose_normals_stray_each_by_itself_do_not_agree_along_a_wall():
    """Walls on both sides, along x; the normals are 0.2 rad off, as good as 160 points that hold x, in truth none."""
    rng = np.random.default_rng(0)
    size = 4000
    places = rng.uniform(-5.0, 5.0, size) + 1j * rng.choice((-1.0, 1.0), size)
    theirs, own = (-1j * np.sign(places.imag) * np.exp(1j * rng.normal(0.0, 0.2, size)) for _ in range(2))
    weights, theirs, own = np.ones(size), jacobian(theirs, places), jacobian(own, places)
    single, shared = normal_equations(theirs, weights)[0, 0], shared_information(table(theirs, weights, own))[0, 0]
    assert single == pytest.approx(0.04 * size, rel=0.1)
    # The sum of as many products of two independent normals of that spread: three standard deviations.
    assert abs(shared) < 3.0 * 0.04 * math.sqrt(size)


def polished(reference, current, candidate):
    """The last iterations of a candidate ``(3,)``, over all points."""
    found = fit(candidate, current.oriented_points, reference.likelihood_field)
    return polish(candidate, found, PARAMETERS.refinement)


def alignment(reference, current):
    return Alignment(current.sampled_points, reference.likelihood_field, 1e-6)


def test_every_candidate_is_refined_to_the_motion():
    reference, current = features(START), features(END)
    near = rows(NEAR, MOTION @ SE2(-0.1, 0.08, -0.05))
    found, _ = refine(near, alignment(reference, current), [0.2, 0.2, 0.1, 0.05, 0.05])
    assert np.abs(found - MOTION.as_array()).max() < 2e-3
    assert np.abs(near[1] - MOTION.as_array()).max() > 0.04
    last, _ = polished(reference, current, found[0])
    assert np.abs(last - MOTION.as_array()).max() < 5e-4


def test_a_candidate_that_would_creep_farther_than_the_kernel_stays():
    reference, current = features(START), features(END)
    near, far = ((MOTION @ SE2(share * FINAL_SCALE, 0.0, 0.0)).as_array() for share in (0.8, 1.3))
    found, _ = polished(reference, current, near)
    assert np.abs(found - MOTION.as_array()).max() < 1e-3
    found, _ = polished(reference, current, far)
    assert (found == far).all()
