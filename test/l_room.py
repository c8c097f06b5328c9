# SPDX-License-Identifier: Apache-2.0
"""Fits of scans of one room, for the tests of refinement and of correspondences."""
import numpy as np
from rooms import FULL, L_ROOM, look, outline

from dbscan_reg_ros import SE2, Parameters
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.registration.fit import fit

DENSITY = Parameters().density
START, END = SE2(-0.6, 0.3, 0.3), SE2(-0.9, 0.1, -0.4)


def features(pose):
    return extract_features(look(outline(L_ROOM), pose, FULL))


def rows(*motions):
    return np.array([motion.as_array() for motion in motions])


def fitted(reference, current, motion):
    return fit(motion.as_array(), current.sampled_points, reference.likelihood_field)


def weight(found, scale):
    """The kernel (Eq. 18) of the errors of a `Fit` ``(P,)``, 0 where the normals disagree."""
    return np.exp(-0.5 * (found.residuals[0] / scale) ** 2) * found.alike


def linear_residuals(found):
    """Derivatives and errors of a `Fit` ``(4, P)``: ``(x, y, theta, 1) @`` them are the errors after a step."""
    return found.residuals[[2, 3, 4, 0]]


def jacobian(normals, rotated_points):
    """The derivatives ``(3, P)`` of the distances of points from lines, by their conjugated normals."""
    return np.array((normals.real, -normals.imag, -(normals * rotated_points).imag))


def normal_equations(rows, weight):
    """The weighted squares of derivatives, or of derivatives and errors, ``(R, P)``."""
    return rows * weight @ rows.T


def table(rows, weight, own):
    """The table ``(8, P)`` of `match_covariance`, without errors."""
    return np.vstack((np.zeros(len(weight)), weight, rows, own))
