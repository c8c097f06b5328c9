# SPDX-License-Identifier: Apache-2.0
"""Location of a scan of a further lidar in the map of the first lidar."""
import math
from typing import NamedTuple

import numpy as np

from ...features.records import Features
from ...geometry.array_types import FloatArray
from ...geometry.se2 import DOF, SE2
from ...geometry.symmetric_matrix import diagonal
from ...mapping.key_frame_window import KeyFrameWindow
from ...mapping.records import InitialAlignment, PosePrior
from ...mapping.scan_to_map import align_to_map, alignment_uncertainty
from ...parameters.tree import Parameters
from ...registration.pipeline import register, register_within_gate
from ...registration.records import Prior, Status
from ..references import degenerate_direction, predicted_along_degenerate


class Location(NamedTuple):
    """Pose of a scan that was located in a map without any influence on the track.

    Attributes
    ----------
    stamp : int [ns]
    pose : SE2
        Pose of the sensor of the scan in the frame of the map.
    covariance : (3, 3) float
        Covariance of `pose` in the frame of the scan [m, m, rad].
    key_frame : int
        `KeyFrame.number` of the latest key frame of the map.
    """

    stamp: int
    pose: SE2
    covariance: FloatArray
    key_frame: int


def locate(features: Features, window: KeyFrameWindow, predicted: SE2 | None, p: Parameters,
           search_parameters: Parameters) -> Location | None:
    """Register a scan to the key frames of another lidar, and align it with all of them.

    Parameters
    ----------
    features : Features
    window : KeyFrameWindow
        Key frames of the other lidar.
    predicted : SE2 or None
        Predicted pose of the scan; the mounting may be wrong by about 0.3 m and 10 deg. None: it is not known.
    p, search_parameters : Parameters
        Parameters of the odometry, and of its registrations to single references.

    Returns
    -------
    Location or None
        None if the registration failed, is ambiguous, or does not constrain the rotation; without a predicted pose also
        if it does not constrain the translation.
    """
    frame = window.latest
    reference = window.local_map_of(frame.sensor.name)
    if predicted is None:
        registration = register(reference, features, search_parameters)
        if registration.status is not Status.OK:
            return None
        pose = frame.pose @ registration.transform
    else:
        prior = Prior(frame.pose.inverse() @ predicted, _UNKNOWN_MOUNTING)
        registration = register_within_gate(reference, features, search_parameters, prior)
        if registration.status not in (Status.OK, Status.DEGENERATE) or registration.rotation_unobservable:
            return None
        pose = predicted_along_degenerate(frame, registration, predicted)
    initial = InitialAlignment(
        pose, degenerate_direction(frame, registration), registration.rotation_unobservable)
    pose, correspondences = align_to_map(window, features, initial, PosePrior(pose, np.zeros((DOF, DOF))), p)
    covariance, observed = alignment_uncertainty(features, pose, correspondences, initial, p)
    angle = observed.angle if observed.weak < p.decision.min_information else initial.direction
    if angle is not None:
        angle -= pose.theta
        direction = np.array([math.cos(angle), math.sin(angle), 0.0])
        covariance = covariance + _UNCONSTRAINED ** 2 * np.outer(direction, direction)
    return Location(features.measured.stamp, pose, covariance, frame.number)


_UNKNOWN_MOUNTING = diagonal(0.15, 0.15, math.radians(4.0)) ** 2
"""Covariance of a predicted pose whose mounting may be wrong [m, m, rad]."""
_UNCONSTRAINED = 100.0
"""Standard deviation [m] of the position along a direction that the map does not constrain."""
