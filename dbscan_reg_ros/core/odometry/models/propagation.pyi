# SPDX-License-Identifier: Apache-2.0
"""Propagation of the covariance of pose and twist."""
from ...geometry.array_types import FloatArray
from ...geometry.se2 import SE2
from ...registration.records import Prior
from .covariance import PoseMeasurement

def propagate_errors(
    joint: FloatArray, step: SE2, interval: float, prior: Prior, measurement: PoseMeasurement
) -> FloatArray: ...
