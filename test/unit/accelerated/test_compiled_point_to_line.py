# SPDX-License-Identifier: Apache-2.0
"""Compiled correspondences against the reference."""
import dataclasses

import numpy as np
import pytest
from accelerated_inputs import SIZES, assert_same, oriented_points

from dbscan_reg_ros import Parameters
from dbscan_reg_ros.core.features.tables import build_likelihood_field
from dbscan_reg_ros.core.registration.point_to_line import fit

DENSITY = Parameters().density


@pytest.mark.parametrize('size', SIZES)
@pytest.mark.parametrize('map_size', [0, 1, 200, 3000, 70_000])
def test_fit(compiled, rng, size, map_size):
    """Indices of one, two and four bytes; points far outside the grid."""
    field = build_likelihood_field(oriented_points(rng, map_size), DENSITY)
    points = oriented_points(rng, size, reach=rng.choice([5.0, 1e6]))
    candidates = rng.normal(0.0, 1.0, (rng.integers(0, 4), 3))
    for cosine in (DENSITY.min_normal_cosine, -1.0):
        assert_same(fit(candidates, points, field, cosine), compiled.step(fit)(candidates, points, field, cosine))


def test_arrays_of_different_lengths_are_an_error(compiled, rng):
    points = oriented_points(rng, 20)
    field = build_likelihood_field(points, DENSITY)
    short = dataclasses.replace(points, normals=points.normals[:10])
    with pytest.raises(IndexError):
        compiled.step(fit)(np.zeros((1, 3)), short, field, 0.5)
