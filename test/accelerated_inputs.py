# SPDX-License-Identifier: Apache-2.0
"""Random and worst inputs for both backends, and what equal results are."""
import dataclasses

import numpy as np

from dbscan_reg_ros.core.features.oriented_points import OrientedPoints

SIZES = 0, 1, 2, 7, 180, 3000
"""Numbers of points: none, one, a few, those of a scan, thousands."""


def oriented_points(rng, size, reach=5.0):
    """Points around the sensor on a wall that zigzags, with weights."""
    angle = np.sort(rng.uniform(-np.pi, np.pi, size))
    points = reach * (1.0 + 0.2 * np.sin(3.0 * angle) + rng.normal(0.0, 0.01, size)) * np.exp(1j * angle)
    normals = -np.exp(1j * (angle + rng.normal(0.0, 0.2, size)))
    return OrientedPoints(points, normals, np.arange(size), rng.uniform(0.0, 1.0, size))


def assert_same(one, other):
    """Whether two results are equal: numbers within 1e-9, all else exactly."""
    if dataclasses.is_dataclass(one):
        for field in dataclasses.fields(one):
            if field.compare or field.repr:
                assert_same(getattr(one, field.name), getattr(other, field.name))
    elif isinstance(one, (tuple, list)):
        assert len(one) == len(other)
        for each, counterpart in zip(one, other):
            assert_same(each, counterpart)
    elif isinstance(one, (np.ndarray, float, complex)):
        one, other = np.asarray(one), np.asarray(other)
        assert one.shape == other.shape and one.dtype.kind == other.dtype.kind
        np.testing.assert_allclose(other, one, rtol=1e-9, atol=1e-9)
    elif not callable(one):
        assert one == other
