# SPDX-License-Identifier: Apache-2.0
"""Fits of scans of one room, for the tests of refinement and of correspondences."""
import numpy as np
from rooms import FULL, L_ROOM, look, outline

from dbscan_reg_ros import SE2, Parameters
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.registration.point_to_line import fit

DENSITY = Parameters().density
START, END = SE2(-0.6, 0.3, 0.3), SE2(-0.9, 0.1, -0.4)


def features(pose):
    return extract_features(look(outline(L_ROOM), pose, FULL))


def rows(*motions):
    return np.array([motion.as_array() for motion in motions])


def fitted(reference, current, *motions):
    return fit(rows(*motions), current.sampled_points, reference.likelihood_field, DENSITY.min_normal_cosine)
