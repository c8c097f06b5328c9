# SPDX-License-Identifier: Apache-2.0
"""Extraction of the features of a scan (sections 2.1 and 2.2)."""
import numpy as np

from ..backend import Backend, default_backend
from ..errors import ScanError
from ..geometry.se2 import as_complex, as_vectors
from ..parameters.tree import Parameters
from ..scan import Scan
from .normals import estimate_normals
from .point_sequence import point_sequence
from .range_noise import estimate_noise, range_noise
from .records import Features
from .returns import Returns, admitted_returns
from .ring_band import ring_band_filter
from .segments import extract_segments

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
    return backend.step(extract_from_returns)(returns, parameters, noise_ratio)


def extract_from_returns(returns: Returns, parameters: Parameters, noise_ratio: float | None = None) -> Features:
    """Extract the features of a scan from its selected returns; parameters and errors are as for `extract_features`."""
    limits, scan = parameters.scan, returns.scan
    filtered, _ = ring_band_filter(returns.points, returns.noise, parameters.filter)
    beams = np.isfinite(filtered[:, 0]).nonzero()[0]
    points = filtered[beams]
    if len(points) < limits.min_returns:
        raise ScanError(f'{len(points)} returns remain after the ring band filter; advanced.scan.min_returns asks for '
                        f'{limits.min_returns}')
    ratio, noise = returns.noise_ratio if noise_ratio is None else noise_ratio, returns.noise
    positions = as_complex(points)
    radius = np.abs(positions)
    # Before the filter, outliers count as noise. Corners must stand out from this noise, normals and breaks need not.
    left = min(noise, estimate_noise(radius, limits)) if len(points) < np.count_nonzero(returns.valid) else noise
    sequence = point_sequence(positions, beams, scan.geometry.angle_increment, left, parameters.segments)
    normals = estimate_normals(sequence, range_noise(radius, left, ratio), parameters.segments)
    segments = extract_segments(sequence, range_noise(radius, noise, ratio), parameters.segments)
    if sequence.increment < 0.0:
        segments = segments.reversed()
    return Features(scan=scan, points=points, beams=beams, breaks=sequence.breaks, normals=as_vectors(normals),
                    segments=segments, noise=left, density=parameters.density, noise_ratio=ratio,
                    backend=returns.backend)
