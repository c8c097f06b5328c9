# SPDX-License-Identifier: Apache-2.0
"""Points with normals: thinning, sampling and leverage."""

import numpy as np
import pytest

from dbscan_reg_ros.core.features.oriented_points import OrientedPoints, sample


@pytest.mark.parametrize('count, kept', [(10, range(10)), (9, range(0, 10, 2)), (5, range(0, 10, 2)),
                                         (4, range(0, 10, 3))])
def test_points_are_thinned_evenly_to_a_maximum_number(count, kept):
    points = np.arange(10.0) + 0j
    assert OrientedPoints(points, points, np.arange(len(points))).thinned(count).points.real.tolist() == list(kept)


def test_a_sample_is_thinned_but_for_points_that_face_where_few_do():
    """A corridor of 40 points, of which two face along it."""
    normals = np.tile([1j, -1j], 20)
    normals[[7, 22]] = 1.0, -1.0
    cloud = OrientedPoints(np.arange(40.0) + 0j, normals, np.arange(40))
    assert sample(cloud, 10).beams.tolist() == [0, 4, 7, 8, 12, 16, 20, 22, 24, 28, 32, 36]
    assert sample(cloud, 40) is cloud
