# SPDX-License-Identifier: Apache-2.0
"""Extraction of the features of a scan (sections 2.1 and 2.2)."""
from ..parameters.tree import Parameters
from ..scan import Scan
from .records import Features
from .returns import Returns

def extract_features(scan: Scan, parameters: Parameters = ..., noise_ratio: float | None = None) -> Features: ...
def extract_from_returns(
    returns: Returns, parameters: Parameters, noise_ratio: float, pole_size: float = 0.0
) -> Features: ...
