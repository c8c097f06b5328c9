# SPDX-License-Identifier: Apache-2.0
"""Random and worst inputs of the compiled steps, and what equal results are."""
import dataclasses

import numpy as np

from dbscan_reg_ros.core.features.oriented_points import OrientedPoints
from dbscan_reg_ros.core.features.records import Segments

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
    elif isinstance(one, (OrientedPoints, Segments)):
        assert_same(one.__reduce__()[1], other.__reduce__()[1])
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


def ranges(rng, size):
    """Ranges [m] of a scan in a room with clutter, outliers and missing returns, and their bearings [rad]."""
    bearings = np.linspace(-np.pi, np.pi, size, endpoint=False)
    distance = 3.0 / np.maximum(np.abs(np.cos(bearings)), np.abs(np.sin(bearings))) + rng.normal(0.0, 0.01, size)
    kind = rng.uniform(size=size)
    distance[kind < rng.uniform(0.0, 0.2)] *= rng.uniform(0.2, 1.2)
    distance[rng.uniform(size=size) < rng.choice([0.0, 0.1, 0.6])] = np.nan
    if size and rng.uniform() < 0.3:
        distance[rng.integers(size):] += 1.0
    return distance, bearings


def scan_points(rng, size):
    """Points ``(N, 2)`` [m] of such a scan; nan without a return."""
    distance, bearings = ranges(rng, size)
    return np.stack((distance * np.cos(bearings), distance * np.sin(bearings)), axis=1)


def segments(rng, size, parallel=False):
    """Line segments anywhere; or parallel and perpendicular ones."""
    start = rng.uniform(-5.0, 5.0, (size, 2))
    direction = rng.integers(-2, 2, size) * np.pi / 2 if parallel else rng.uniform(-np.pi, np.pi, size)
    length = rng.uniform(0.2, 4.0, size)
    end = start + length[:, None] * np.stack((np.cos(direction), np.sin(direction)), axis=1)
    return Segments(start=start, end=end, direction=direction, length=length,
                    sigma_direction=rng.uniform(0.0, 0.1, size), sigma_offset=rng.uniform(0.0, 0.1, size),
                    kinds=rng.integers(0, 3, (size, 2)), beams=rng.integers(0, 100, (size, 2)))
