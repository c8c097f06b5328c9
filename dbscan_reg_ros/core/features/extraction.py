# SPDX-License-Identifier: Apache-2.0
"""Extraction of the features of a scan (sections 2.1 and 2.2)."""
from ..backend import Backend, default_backend
from ..parameters.tree import Parameters
from ..scan import Scan
from .extract import extract_from_returns
from .records import Features
from .returns import admitted_returns

_DEFAULTS = Parameters()


def extract_features(scan: Scan, parameters: Parameters = _DEFAULTS, noise_ratio: float | None = None,
                     backend: Backend | None = None) -> Features:
    """Filter a scan and describe it by points, normals and line segments (sections 2.1 and 2.2).

    Parameters
    ----------
    scan : Scan
    parameters : Parameters
    noise_ratio : float, optional
        Standard deviation of a range as a fraction of the range, if it is known from several scans of this sensor. By
        default it is estimated from this scan.
    backend : Backend, optional
        Implementation of the numerical steps; by default the compiled one, if it is built. The features store it.

    Raises
    ------
    ScanError
        When fewer than `scan.min_returns` beams have a return.
    """
    backend = backend or default_backend()
    returns = admitted_returns(scan, parameters.scan, backend)
    return extract_from_returns(returns, parameters, noise_ratio)
