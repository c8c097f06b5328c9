# SPDX-License-Identifier: Apache-2.0
"""Covariance and observability of a registered motion, estimated from its residuals."""
from ..geometry.array_types import FloatArray
from ..parameters.registration import DecisionParameters
from .residuals import Observability

def match_covariance(
    table: FloatArray,
    noise: float,
    parameters: DecisionParameters,
    theta: float,
    latest_degenerate: bool = False,
    rotation_unobservable: bool = False,
) -> tuple[FloatArray, Observability]: ...
def shared_information(table: FloatArray) -> FloatArray: ...
def degenerate_translation(angle: float, shared: FloatArray, parameters: DecisionParameters) -> FloatArray: ...
def degenerate_rotation(
    information: FloatArray, shared: FloatArray, parameters: DecisionParameters
) -> FloatArray: ...
