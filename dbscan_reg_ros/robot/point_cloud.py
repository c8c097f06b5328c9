# SPDX-License-Identifier: Apache-2.0
"""Conversion of PointCloud2 messages of 3D lidars to planar scans, the same in the node and in replays."""
import math
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..core.beams import Header
from ..core.errors import ScanError
from ..core.geometry.rounding import fixed
from ..core.scan import SECOND, Scan, in_nanoseconds
from ..core.scan_geometry import ScanGeometry
from .parameter_groups import InputParameters

Array = NDArray[np.float64]

DATATYPES = {1: 'i1', 2: 'u1', 3: 'i2', 4: 'u2', 5: 'i4', 6: 'u4', 7: 'f4', 8: 'f8'}
"""Constants of sensor_msgs/PointField -> numpy types."""
TIMES = ('time', 't', 'timestamp', 'offset_time')
"""Names of the field with the time of each point: Velodyne, Ouster, Hesai and RoboSense, Livox."""
LARGEST_SECONDS = 1e12
"""Floating-point times above this are in nanoseconds, as of Livox; integer times always are."""
SAME_CLOCK = 1.0
"""Times of the points that differ by more than this [s] from the stamp of the message are those of another clock."""
SAMPLE = 1000
"""Approximate number of points whose unit and axes are checked."""
IN_ORDER = 0.1
"""The points were measured in the order of their bearings if the median deviation from a constant turn rate is at most
this fraction of the duration of the message."""


class PointField(Protocol):
    """The fields of a sensor_msgs/PointField message."""

    name: str
    offset: int
    datatype: int


class PointCloudMessage(Protocol):
    """The fields of a sensor_msgs/PointCloud2 message that a scan is made of."""

    header: Header
    height: int
    width: int
    fields: Sequence[PointField]
    is_bigendian: bool
    point_step: int
    row_step: int
    data: Any


class _Order(NamedTuple):
    """Order of the beams of a scan in time, estimated from the times of its points.

    `first` is the number of the first beam, `sign` 1 (counter-clockwise) or -1, `start` the time of the first beam [s]
    and `increment` the time from one beam to the next [s].
    """

    first: int = 0
    sign: int = 1
    start: float = 0.0
    increment: float = 0.0


def scan_from_cloud(message: PointCloudMessage, matrix: Array, parameters: InputParameters) -> Scan:
    """Make a scan of the points of a point cloud that lie between two heights above the base.

    The scan has a beam for each bin of ``input.bearing_step`` around the lidar, with the nearest point of the bin, at
    the bearing of that point. The stamp and the time increment are those of the field `TIMES`, if there is one; if the
    points are not in the order of their bearings, the stamp is their mean time and the time increment 0.

    Parameters
    ----------
    message : PointCloudMessage
    matrix : (4, 4) float
        Transforms points [m] from the frame of the message to the base frame.
    parameters : InputParameters
        Their ``time_offset`` has been added to the stamp of the message.

    Returns
    -------
    Scan
        Scan of an upright lidar at the position of the 3D lidar, with the axes of the base.

    Raises
    ------
    ScanError
        When the fields of the message contradict each other, or there is no field x, y or z.
    """
    points = _read(message)
    rotation, position = matrix[:3, :3], matrix[:3, 3]
    xyz = np.stack([points[name].astype(float) for name in 'xyz'])
    with np.errstate(invalid='ignore', over='ignore'):
        # Three sums instead of a matrix product, which warns of points that are not finite.
        x, y, z = (row[0] * xyz[0] + row[1] * xyz[1] + row[2] * xyz[2] for row in rotation)
        ranges = np.hypot(x, y)
        used = (z + position[2] >= parameters.height_min) & (z + position[2] <= parameters.height_max)
        # Many drivers send the origin for a beam without a return.
        used &= np.isfinite(ranges) & (ranges > 0.0)
    chosen = used.nonzero()[0]
    count = max(round(2.0 * math.pi / parameters.bearing_step), 1)
    bearings = np.arctan2(y[chosen], x[chosen])
    bins = np.minimum(((bearings + math.pi) * (count / (2.0 * math.pi))).astype(int), count - 1)
    order = np.lexsort((ranges[chosen], bins))
    nearest = order[np.diff(bins[order], prepend=-1) > 0]
    bins, bearings, chosen = bins[nearest], bearings[nearest], chosen[nearest]
    stamp = in_nanoseconds(message.header.stamp)
    times = _times(points, chosen, 1e-9 * stamp - parameters.time_offset[0])
    beams = _Order() if times is None else _order(bins, times, count)
    return _scan(message, count, beams, (bins, bearings, ranges[chosen]))


def some_points(message: PointCloudMessage) -> Array:
    """Return about `SAMPLE` of the measured points of a message, ``(N, 3)``, in its frame."""
    points = _read(message)
    points = points[::max(len(points) // SAMPLE, 1)]
    xyz = np.stack([points[name].astype(float) for name in 'xyz'], axis=1)
    return np.asarray(xyz[np.isfinite(xyz).all(axis=1) & xyz.any(axis=1)])


def no_points(message: PointCloudMessage, matrix: Array, parameters: InputParameters) -> str:
    """Return a sentence on a point cloud of which `scan_from_cloud` uses no point, with the heights of its points."""
    points = _read(message)
    x, y, z = (points[name].astype(float) for name in 'xyz')
    measured = np.isfinite(x) & np.isfinite(y) & np.isfinite(z) & ((x != 0.0) | (y != 0.0))
    band = f'between input.height_min = {parameters.height_min:g} m and input.height_max = {parameters.height_max:g} m'
    if not measured.any():
        return f'the point cloud has no point, {band} or elsewhere'
    heights = np.column_stack((x, y, z))[measured] @ matrix[2, :3] + matrix[2, 3]
    return (f'the point cloud has no point {band}; the heights of its points in base_frame are from '
            f'{fixed(heights.min(), 2)} m to {fixed(heights.max(), 2)} m')


def _scan(message: PointCloudMessage, count: int, order: _Order,
          nearest: tuple[NDArray[np.int64], Array, Array]) -> Scan:
    """Make the scan of `count` beams in the given order from numbers, bearings and ranges of the `nearest` points."""
    numbers, found, distances = nearest
    step = 2.0 * math.pi / count
    bearings = -math.pi + step * (np.arange(count) + 0.5)
    ranges = np.full(count, np.inf)
    bearings[numbers], ranges[numbers] = found, distances
    beams = (order.first + order.sign * np.arange(count)) % count
    geometry = ScanGeometry.from_bearings(np.unwrap(bearings[beams]), order.sign * step)
    stamp = in_nanoseconds(message.header.stamp) + round(order.start * SECOND)
    return Scan(stamp, ranges[beams], geometry, order.increment, message.header.frame_id)


def _read(message: PointCloudMessage) -> NDArray[Any]:
    """Return the points of a message ``(N,)`` as a structured array with x, y, z, and one of `TIMES` if it has one."""
    height, width, step = message.height, message.width, message.point_step
    row_step = message.row_step if height > 1 else width * step
    data = np.frombuffer(message.data, dtype=np.uint8)
    needed = (height - 1) * row_step + width * step if height and width else 0
    if row_step < width * step or len(data) < needed:
        raise ScanError(f'a point cloud of {len(data)} bytes with height {height}, width {width}, point_step {step} '
                        f'and row_step {row_step}; expected at least {max(needed, height * width * step)} bytes')
    wanted = {field.name: field for field in reversed(message.fields) if field.name in ('x', 'y', 'z', *TIMES)}
    missing = [name for name in 'xyz' if name not in wanted]
    if missing:
        raise ScanError(f'a point cloud with the fields {", ".join(field.name for field in message.fields) or "none"}; '
                        f'expected a field {missing[0]}')
    formats = [_format(field, step, message.is_bigendian) for field in wanted.values()]
    kind = np.dtype({'names': list(wanted), 'formats': formats,
                     'offsets': [field.offset for field in wanted.values()], 'itemsize': step})
    return np.ndarray((height, width), kind, data, strides=(row_step, step)).ravel()


def _format(field: PointField, step: int, is_bigendian: bool) -> str:
    """Return the numpy type of a field of points of `step` bytes."""
    kind = DATATYPES.get(field.datatype)
    if kind is None or field.offset + int(kind[1]) > step:
        raise ScanError(f'the field {field.name} of a point cloud has the datatype {field.datatype} and the offset '
                        f'{field.offset}; expected a datatype from 1 to 8, within the point_step {step}')
    return ('>' if is_bigendian else '<') + kind


def _times(points: NDArray[Any], chosen: NDArray[np.int64], stamp: float) -> Array | None:
    """Return the times of the `chosen` points after the `stamp` of the message [s]; None if they are unknown."""
    name = next((name for name in TIMES if name in (points.dtype.names or ())), None)
    if name is None or len(chosen) <= 1:
        return None
    times = points[name][chosen].astype(float)
    if not np.isfinite(times).all():
        return None
    seconds = points.dtype[name].kind == 'f' and abs(times[0]) < LARGEST_SECONDS
    scale = 1.0 if seconds else 1e-9
    start, after = scale * float(times[0]), scale * (times - times[0])
    for origin in (0.0, stamp):
        if abs(start - origin) <= SAME_CLOCK:
            return np.asarray(after + (start - origin))
    return np.asarray(after - after.min())


def _order(bins: NDArray[np.int64], times: Array, count: int) -> _Order:
    """Estimate the order of `count` beams from the times [s] of the points in some of them, `bins` ``(N,)``."""
    first = int(bins[times.argmin()])
    fits = [(*_line(sign * (bins - first) % count, times), sign) for sign in (1, -1)]
    deviation, start, increment, sign = min(fits)
    if increment <= 0.0 or deviation > IN_ORDER * increment * count:
        return _Order(start=float(times.mean()))
    return _Order(first, sign, start, increment)


def _line(positions: NDArray[np.int64], times: Array) -> tuple[float, float, float]:
    """Fit a line to `times` over `positions` by medians; return median deviation, value at position 0, and slope."""
    order = positions.argsort(kind='stable')
    positions, times = positions[order], times[order]
    half = len(order) // 2
    (early, first), (late, last) = (np.median((positions[part], times[part]), axis=1)
                                    for part in (slice(None, half), slice(half, None)))
    slope = float((last - first) / max(late - early, 1.0))
    start = float(np.median(times - slope * positions))
    return float(np.median(np.abs(times - slope * positions - start))), start, slope
