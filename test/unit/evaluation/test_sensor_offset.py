# SPDX-License-Identifier: Apache-2.0
"""A trajectory of the base is recognised by the constant pose of the sensor that explains its error."""
import numpy as np
import pytest

from dbscan_reg_ros.evaluation.sensor_offset import hint, sensor_offset
from dbscan_reg_ros.recordings.poses import compose, relative


def motions(rng, count=200):
    """Motions of a sensor over 1 m with rotations."""
    return np.column_stack((rng.normal(1.0, 0.05, count), rng.normal(0.0, 0.1, count), rng.normal(0.0, 0.4, count)))


@pytest.mark.parametrize('offset', [(0.3, -0.1, 0.0), (0.0, 0.0, 3.0), (-0.2, 0.1, 1.5)])
def test_the_pose_of_the_sensor_is_found_and_named(offset):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        true = motions(rng)
        placed = np.broadcast_to(offset, true.shape)
        base = compose(compose(placed, true), relative(placed, np.zeros(true.shape)))
        base += 0.001 * rng.normal(size=true.shape)
        np.testing.assert_allclose(sensor_offset(base, true), offset, atol=0.01)
        assert f'at about {offset[0]:.2f},{offset[1]:.2f},{np.degrees(offset[2]):.0f} on' in hint(base, true)


def test_other_errors_give_no_hint():
    """Noise, a wrong scale, a wrong rotation, no motion, and poses that are right."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        true = motions(rng)
        for found in (true + 0.05 * rng.normal(size=true.shape), true * (0.9, 0.9, 1.0), true * (1.0, 1.0, 0.8) + 0.02,
                      np.zeros(true.shape), true):
            assert hint(found, true) == ''
