"""Everything that is kept of one scan, computed once."""
import numpy as np

from .errors import ScanError
from .parameters import Parameters
from .records import Features
from .ring_band import ring_band_filter
from .scan import Scan
from .segments import extract_segments, find_breaks, fit_lines, point_moments


def extract_features(scan: Scan, parameters: Parameters = Parameters()) -> Features:
    """Filter a scan and describe it by points, normals and line segments (sections 2.1 and 2.2).

    Raises
    ------
    ScanError
        When fewer than `scan.min_returns` beams have a return.
    """
    valid = scan.valid
    limits = parameters.scan
    if limits.range_min > 0.0:
        valid = valid & (scan.ranges >= limits.range_min)
    if limits.range_max > 0.0:
        valid = valid & (scan.ranges <= limits.range_max)
    returns = int(np.count_nonzero(valid))
    if returns < limits.min_returns:
        raise ScanError(f'{returns} of {scan.geometry.size} beams have a return; scan.min_returns asks for '
                        f'{limits.min_returns}')
    raw = scan.points if valid is scan.valid else np.where(valid[:, None], scan.points, np.nan)
    noise = estimate_noise(scan.ranges[valid].astype(float), limits)
    filtered, outcome = ring_band_filter(raw, noise, parameters.filter)
    beams = np.flatnonzero(np.isfinite(filtered[:, 0]))
    points = filtered[beams]
    if len(points) < limits.min_returns:
        raise ScanError(f'{len(points)} returns remain after the ring band filter; scan.min_returns asks for '
                        f'{limits.min_returns}')
    radius = np.hypot(points[:, 0], points[:, 1])
    breaks = find_breaks(points, radius, beams, scan.geometry, noise, parameters.segments)
    normals = estimate_normals(points, breaks, scan.geometry.angle_increment, parameters.segments)
    segments = extract_segments(points, radius, beams, breaks, noise, parameters.segments)
    return Features(scan, points, beams, normals, segments, noise, parameters.density)


def estimate_noise(ranges, limits):
    """Standard deviation of a range [m], from second differences along the scan.

    A low quantile of them, so that corners, jumps and a good share of outliers do not matter; kept within the limits.
    """
    if len(ranges) < 8:
        return limits.noise_max
    bend = np.abs(ranges[1:-1] - 0.5 * (ranges[2:] + ranges[:-2]))
    at = int(_NOISE_QUANTILE * len(bend))
    return float(np.clip(np.partition(bend, at)[at] / _NOISE_BEND, limits.noise_min, limits.noise_max))


_NOISE_QUANTILE = 0.3
# That quantile of |N(0, 1)|, for a second difference with weights 1, -1/2, -1/2.
_NOISE_BEND = 0.38532 * np.sqrt(1.5)


def estimate_normals(points, breaks, increment, parameters):
    """Unit normals ``(P, 2)`` on the sensor's side, from the neighbours of each point within its run.

    The side follows from the order of the beams and the sign of their `increment`.

    The window grows from `normal_beams` on each side until it spans `normal_reach`; points with fewer than three
    neighbours on their surface get a zero normal.
    """
    size = len(points)
    step = np.hypot(*(points[1:] - points[:-1]).T)
    step[breaks] = 0.0
    path = np.concatenate(([0.0], np.cumsum(step)))
    edge = np.concatenate(([0], np.flatnonzero(breaks) + 1, [size]))
    run = np.repeat(np.arange(len(edge) - 1), np.diff(edge))
    index = np.arange(size)
    low = np.minimum(np.searchsorted(path, path - parameters.normal_reach), index - parameters.normal_beams)
    high = np.maximum(np.searchsorted(path, path + parameters.normal_reach, 'right'), index + parameters.normal_beams + 1)
    low, high = np.maximum(low, edge[run]), np.minimum(high, edge[run + 1])
    total = np.zeros((size + 1, 5))
    np.cumsum(point_moments(points), axis=0, out=total[1:])
    count = high - low
    _, angle, spread, residual = fit_lines(total[high] - total[low], count)
    normals = np.stack((-np.sin(angle), np.cos(angle)), axis=1)
    onward = points[high - 1] - points[low]
    turned = (onward[:, 0] * normals[:, 1] - onward[:, 1] * normals[:, 0]) * increment < 0.0
    normals[turned] *= -1.0
    normals[(count < 3) | (residual > 0.25 * spread)] = 0.0
    return normals
