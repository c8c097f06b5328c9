# SPDX-License-Identifier: Apache-2.0
"""Features of a scan whose returns are selected (sections 2.1 and 2.2)."""
from ..parameters.tree import Parameters
from .records import Features
from .returns import Returns

def extract_from_returns(returns: Returns, parameters: Parameters, noise_ratio: float | None = None) -> Features: ...
