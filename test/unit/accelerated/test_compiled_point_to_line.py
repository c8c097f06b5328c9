# SPDX-License-Identifier: Apache-2.0
"""Compiled correspondences and iterations against the reference."""
import dataclasses

import numpy as np
import pytest
from accelerated_inputs import SIZES, assert_same, oriented_points

from dbscan_reg_ros import Parameters
from dbscan_reg_ros.core.features.likelihood_field import build_likelihood_field
from dbscan_reg_ros.core.registration.point_to_line import Alignment, fit, refine

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


@pytest.mark.parametrize('size', SIZES)
def test_refine(compiled, rng, size):
    field = build_likelihood_field(oriented_points(rng, 400), DENSITY)
    points = oriented_points(rng, size)
    for inverse_noise, cosine in (None, 0.5), (rng.uniform(0.1, 1.0, size), -1.0):
        alignment = Alignment(dataclasses.replace(points, inverse_noise=inverse_noise), field, cosine, 1e-3)
        candidates = rng.normal(0.0, 0.3, (4, 3))
        known = fit(candidates, alignment.points, field, cosine)
        for scales in (), (0.3,), (0.5, 0.2, 0.05):
            assert_same(refine(candidates, alignment, scales), compiled.step(refine)(candidates, alignment, scales))
            assert_same(refine(candidates, alignment, scales, known),
                        compiled.step(refine)(candidates, alignment, scales, known))


def test_arrays_of_different_lengths_are_an_error(compiled, rng):
    points = oriented_points(rng, 20)
    field = build_likelihood_field(points, DENSITY)
    short = dataclasses.replace(points, normals=points.normals[:10])
    with pytest.raises(IndexError):
        compiled.step(fit)(np.zeros((1, 3)), short, field, 0.5)
