# SPDX-License-Identifier: Apache-2.0
"""Covariance and observability of a registered motion, estimated from its residuals."""
from ..features.oriented_points import OrientedPoints
from ..geometry.array_types import FloatArray
from ..parameters.registration import DecisionParameters
from ..parameters.tree import Parameters
from .residuals import Fit, Observability, Residuals

def uncertainty(
    candidate: FloatArray, found: Fit, points: OrientedPoints, noise: float, p: Parameters
) -> tuple[FloatArray, Observability]: ...
def match_covariance(
    residuals: Residuals,
    parameters: DecisionParameters,
    theta: float,
    latest_degenerate: bool = False,
    rotation_unobservable: bool = False,
) -> tuple[FloatArray, Observability]: ...
def shared_information(rows: FloatArray, weight: FloatArray, own: FloatArray) -> FloatArray: ...
def degenerate_translation(angle: float, shared: FloatArray, parameters: DecisionParameters) -> FloatArray: ...
def degenerate_rotation(
    information: FloatArray, shared: FloatArray, parameters: DecisionParameters
) -> FloatArray: ...
