# SPDX-License-Identifier: Apache-2.0
"""Rounding errors decide nothing: equal hypotheses keep their order, whatever the last bits are."""
from functools import partial

import numpy as np
import pytest
from compiled_inputs import assert_same

from dbscan_reg_ros import Parameters
from dbscan_reg_ros.core.features.records import EndKind, Segments
from dbscan_reg_ros.core.geometry.ties import first_largest, order_up_to_rounding
from dbscan_reg_ros.core.registration.clustering.rotation import estimate_rotations, pair_weights
from dbscan_reg_ros.core.registration.clustering.translation import estimate_translations

P = Parameters()
ROUNDING = 1e-15


@pytest.fixture(params=range(3))
def rng(request):
    return np.random.default_rng(request.param)


def rounded_otherwise(rng, values):
    return values * (1.0 + rng.uniform(-ROUNDING, ROUNDING, np.shape(values)))


def walls(sides, rng=None):
    """The walls of a room, the sides of a regular polygon; with a `rng` with other last bits."""
    corner = 3.0 * np.exp(2j * np.pi * (np.arange(sides) / sides + 0.05))
    other = np.array if rng is None else partial(rounded_otherwise, rng)
    start, end = (other(np.stack((each.real, each.imag), axis=1)) for each in (corner, np.roll(corner, -1)))
    along = np.roll(corner, -1) - corner
    return Segments(start=start, end=end, direction=other(np.angle(along)), length=other(np.abs(along)),
                    sigma_direction=np.full(sides, 0.01), sigma_offset=np.full(sides, 0.01),
                    kinds=np.full((sides, 2), int(EndKind.CORNER)), beams=np.zeros((sides, 2), dtype=int))


@pytest.mark.parametrize('sides', [4, 5])
def test_motions_of_equal_weight_are_in_the_order_of_the_scan(rng, sides):
    """Each wall of the room fits each other one as well: there are as many rotations of equal weight as walls."""
    def motions(ours, theirs):
        weights = pair_weights(ours, theirs, P.rotation)
        rotations = estimate_rotations(ours, theirs, weights, P.rotation)
        found = estimate_translations(ours, theirs, rotations, weights, P.translation)
        assert len(rotations.phi) == min(sides, P.rotation.max_hypotheses)
        np.testing.assert_allclose(rotations.weight, rotations.weight[0])
        return np.exp(1j * rotations.phi), found.transform[:, :2], np.exp(1j * found.transform[:, 2])

    expected = motions(walls(sides), walls(sides))
    for _ in range(20):
        assert_same(expected, motions(walls(sides, rng), walls(sides, rng)))


def test_keys_that_differ_by_rounding_keep_their_order(rng):
    keys = rng.integers(-3, 4, 200) / 3.0
    for _ in range(20):
        np.testing.assert_array_equal(order_up_to_rounding(rounded_otherwise(rng, keys)), keys.argsort(kind='stable'))
        assert first_largest(rounded_otherwise(rng, keys)) == keys.argmax()
    assert first_largest(np.array([1.0, 1.0 + 1e-9])) == 1
