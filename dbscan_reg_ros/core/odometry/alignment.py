# SPDX-License-Identifier: Apache-2.0
"""Alignment of a registered scan with the map."""
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.se2 import SE2
from ..mapping.correspondences import Correspondences
from ..mapping.key_frame_window import KeyFrameWindow
from ..mapping.records import InitialAlignment, PosePrior
from ..mapping.scan_to_map import align_to_map, alignment_uncertainty
from ..parameters.tree import Parameters
from ..registration.records import Prior, Registration
from .models.motion import MotionConstraints
from .prediction import Predictions
from .references import Match


class Aligned(NamedTuple):
    """A scan aligned with the map.

    Attributes
    ----------
    pose : SE2
        Pose of the scan in the odometry frame.
    covariance : (3, 3) float
        Covariance from the alignment with the map alone, in the frame of the scan [m, m, rad].
    direction : float or None [rad]
        Direction of the translation that the map constrains least, in the odometry frame.
    constrained : float
        How well the map constrains the direction that was degenerate in the match, from 0 to 1; 1 if none was.
    correspondences : Correspondences or None
        Correspondences with the key frames; None if no window is used.
    """

    pose: SE2
    covariance: NDArray[np.float64]
    direction: float | None
    constrained: float
    correspondences: Correspondences | None

    def motion_constraints(self, prior: Prior, registration: Registration) -> MotionConstraints:
        """Return the constraints for the motion model; a measured translation is one in every direction."""
        return MotionConstraints(self.direction if self.constrained < 1.0 else None,
                                 1.0 if prior.measures_translation else self.constrained,
                                 registration.rotation_unobservable)


def _constrained(direction: float | None, information: float | None, p: Parameters) -> float:
    """Return how well a degenerate `direction` is constrained, from 0 to 1; `information` is a number of points."""
    return 1.0 if direction is None or information is None else min(information / p.decision.min_information, 1.0)


def align_scan(window: KeyFrameWindow, match: Match, prior: PosePrior, predictions: Predictions,
               p: Parameters) -> Aligned:
    """Align the scan of a match with the key frames of the window; if no window is used, return the match.

    Parameters
    ----------
    window : KeyFrameWindow
    match : Match
    prior : PosePrior
        Its information is in the frame of the scan [1/m^2, 1/rad^2], and 0 if the match contradicts the prior.
    predictions : Predictions
    p : Parameters
    """
    registration, direction = match.registration, match.degenerate_direction
    if p.odometry.reference != 'window':
        constrained = _constrained(direction, registration.weakest_information, p)
        return Aligned(match.pose, registration.covariance, direction, constrained, None)
    initial = InitialAlignment(match.pose, direction, registration.rotation_unobservable)
    # An unobservable rotation is left to an external prior; the motion model knows it no better than the match.
    rotation_by_prior = (registration.rotation_unobservable and not predictions.by_motion_model
                         and bool(prior.information.any()))
    pose, correspondences = align_to_map(
        window, match.features, initial._replace(rotation_unobservable=rotation_by_prior), prior, p,
        coarse=window.of_sensor(match.key_frame.sensor.name))
    covariance, observed = alignment_uncertainty(match.features, pose, correspondences, initial, p)
    return Aligned(pose, covariance, observed.angle, _constrained(direction, observed.weak, p), correspondences)
