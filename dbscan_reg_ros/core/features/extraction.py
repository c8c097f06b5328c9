# SPDX-License-Identifier: Apache-2.0
"""Extraction of the features of a scan (sections 2.1 and 2.2)."""
import numpy as np

from ..errors import ScanError
from ..parameters.tree import Parameters
from ..scan import Scan
from .noise import estimate_noise, range_noise
from .points import finite_points
from .records import Features
from .returns import Returns, admitted_returns
from .ring_band import ring_band_filter
from .segments import extract_segments
from .surfaces import estimate_normals, point_sequence

_DEFAULTS = Parameters()


def extract_features(scan: Scan, parameters: Parameters = _DEFAULTS, noise_ratio: float | None = None) -> Features:
    """Filter a scan and describe it by points, normals and line segments (sections 2.1 and 2.2).

    Parameters
    ----------
    scan : Scan
    parameters : Parameters
    noise_ratio : float, optional
        Standard deviation of a range as a fraction of the range, if it is known from several scans of this sensor. By
        default it is estimated from this scan.

    Raises
    ------
    ScanError
        When fewer than `scan.min_returns` beams have a return.
    """
    return extract_from_returns(admitted_returns(scan, parameters.scan), parameters, noise_ratio)


def extract_from_returns(returns: Returns, parameters: Parameters, noise_ratio: float | None = None) -> Features:
    """Extract the features of a scan whose returns are selected already; as `extract_features`."""
    limits, scan = parameters.scan, returns.scan
    noise = left = returns.noise
    filtered, _ = ring_band_filter(returns.points, noise, parameters.filter)
    points, positions, radii, beams = finite_points(filtered)
    if len(points) < limits.min_returns:
        raise ScanError(f'{len(points)} returns remain after the ring band filter; advanced.scan.min_returns asks for '
                        f'{limits.min_returns}')
    ratio = returns.noise_ratio if noise_ratio is None else noise_ratio
    # Before the filter, outliers count as noise. Corners must stand out from this noise, normals and breaks need not.
    if len(points) < np.count_nonzero(returns.valid):
        left = min(noise, estimate_noise(radii, limits))
    sequence = point_sequence(positions, beams, scan.geometry.angle_increment, left, parameters.segments)
    normals = estimate_normals(sequence, range_noise(radii, left, ratio), parameters.segments)
    segments = extract_segments(sequence, range_noise(radii, noise, ratio), parameters.segments)
    if sequence.increment < 0.0:
        segments = segments.reversed()
    return Features(scan, points, beams, sequence.breaks, normals.view(float).reshape(-1, 2), segments, left,
                    parameters.density, ratio)
