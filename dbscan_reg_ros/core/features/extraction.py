# SPDX-License-Identifier: Apache-2.0
"""Everything that is kept of one scan, computed once."""
import numpy as np

from ..errors import ScanError
from ..geometry.line_fit import fit_lines, summed_moments
from ..geometry.se2 import as_complex, as_vectors
from ..parameters.tree import Parameters
from ..scan import Scan
from .range_noise import estimate_noise, estimate_noise_ratio, range_noise
from .records import Features
from .ring_band import ring_band_filter
from .segments import extract_segments, find_breaks


def extract_features(scan: Scan, parameters: Parameters = Parameters(), noise_ratio=None) -> Features:
    """Filter a scan and describe it by points, normals and line segments (sections 2.1 and 2.2).

    Parameters
    ----------
    scan : Scan
    parameters : Parameters
    noise_share : float, optional
        That of the sensor, where it is known better than from this scan.

    Raises
    ------
    ScanError
        When fewer than `scan.min_returns` beams have a return.
    """
    limits = parameters.scan
    filtered, _, returns, noise = filtered_points(scan, parameters)
    beams = np.isfinite(filtered[:, 0]).nonzero()[0]
    points = filtered[beams]
    if len(points) < limits.min_returns:
        raise ScanError(f'{len(points)} returns remain after the ring band filter; scan.min_returns asks for '
                        f'{limits.min_returns}')
    places = as_complex(points)
    radius, total = np.abs(places), summed_moments(places)
    # Outliers count as noise while they are there. Corners have to stand out from all of it.
    left = min(noise, estimate_noise(radius, limits)) if len(points) < returns else noise
    share = scan_noise_ratio(scan, limits) if noise_ratio is None else noise_ratio
    breaks = find_breaks(places, radius, beams, scan.geometry, left, parameters.segments)
    normals = estimate_normals(places, total, breaks, scan.geometry.angle_increment, range_noise(radius, left, share),
                               parameters.segments)
    segments = extract_segments(places, total, radius, beams, breaks, range_noise(radius, noise, share), parameters.segments)
    if scan.geometry.angle_increment < 0.0:
        segments = segments.reversed()
    return Features(scan, points, beams, normals, segments, left, parameters.density, share)


def scan_noise_ratio(scan, limits):
    """`estimate_noise_ratio` of what the `ScanParameters` leave of a scan."""
    points = as_complex(usable_points(scan, limits))
    beams = np.isfinite(points.real).nonzero()[0]
    return estimate_noise_ratio(points[beams], beams, limits)


def filtered_points(scan: Scan, parameters: Parameters):
    """What the ring band filter leaves of a scan.

    Returns
    -------
    points : (N, 2) array [m]
        Not finite without a return, or when removed.
    outcome : (N,) int array
        What it did with each beam, an `Outcome`.
    returns : int
        That there were before.
    noise : float
        Standard deviation of their ranges [m].

    Raises
    ------
    ScanError
        When fewer than `scan.min_returns` beams have a return.
    """
    limits = parameters.scan
    raw = usable_points(scan, limits)
    valid = np.isfinite(raw[:, 0])
    returns = int(np.count_nonzero(valid))
    if returns < limits.min_returns:
        raise ScanError(f'{returns} of {scan.geometry.size} beams have a return; scan.min_returns asks for '
                        f'{limits.min_returns}')
    noise = estimate_noise(scan.ranges[valid].astype(float), limits)
    return *ring_band_filter(raw, noise, parameters.filter), returns, noise


def usable_points(scan, limits):
    """``(N, 2)`` points of a scan [m]; not finite without a return, or where the `ScanParameters` leave it out."""
    ranges, points = scan.ranges, scan.points
    if limits.range_min > 0.0:
        points = np.where((ranges >= limits.range_min)[:, None], points, np.nan)
    if limits.range_max > 0.0:
        points = np.where((ranges <= limits.range_max)[:, None], points, np.nan)
    return points


def estimate_normals(points, total, breaks, increment, noise, parameters):
    """Unit normals on the sensor's side, from the neighbours of each point within its run.

    The side follows from the order of the beams and the sign of their `increment`. The window grows from `normal_beams`
    on each side until it spans `normal_reach`, or `normal_noise` times the noise where that is more: noise lies along the
    beams, and turns what is fitted to little more than that. Points with fewer than three neighbours on their surface get a
    zero normal. The way along a surface is measured over three beams at a time: noise makes a zigzag of single steps.

    Parameters
    ----------
    points : (P,) complex array [m]
    total : (5, P + 1) array
        Their `summed_moments`.
    breaks : (P - 1,) bool array
    noise : (P,) array
        Standard deviation of each range [m].

    Returns
    -------
    (P, 2) array
    """
    size, step = len(points), np.abs(points[1:] - points[:-1])
    onward = ~(breaks[:-2] | breaks[1:-1] | breaks[2:])
    step[1:-1][onward] = np.abs(points[3:] - points[:-3])[onward] / 3.0
    path = np.zeros(size)
    step[breaks] = 0.0
    step.cumsum(out=path[1:])
    edge = np.concatenate(([0], breaks.nonzero()[0] + 1, [size]))
    first, end = edge[:-1], edge[1:]
    index, length = np.arange(size), end - first
    reach = np.maximum(parameters.normal_reach, parameters.normal_noise * noise)
    low = np.minimum(path.searchsorted(path - reach), index - parameters.normal_beams)
    high = np.maximum(path.searchsorted(path + reach, 'right'), index + (parameters.normal_beams + 1))
    low, high = np.maximum(low, first.repeat(length)), np.minimum(high, end.repeat(length))
    count = high - low
    _, angle, spread, residual = fit_lines(total.take(high, axis=1) - total.take(low, axis=1), count)
    normals = 1j * np.exp(1j * angle)
    onward = points[high - 1] - points[low]
    np.negative(normals, out=normals, where=(onward.conj() * normals).imag * increment < 0.0)
    normals[(count < 3) | (residual > 0.25 * spread)] = 0.0
    return as_vectors(normals)
