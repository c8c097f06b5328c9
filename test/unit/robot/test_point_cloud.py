# SPDX-License-Identifier: Apache-2.0
"""Point clouds as scans: against a loop over the bytes, and the order of the beams in time."""
import math
import struct
from types import SimpleNamespace

import numpy as np
import pytest

from dbscan_reg_ros.core.errors import ScanError
from dbscan_reg_ros.robot.parameter_groups import InputParameters
from dbscan_reg_ros.robot.point_cloud import scan_from_cloud

CODES = {1: 'b', 2: 'B', 3: 'h', 4: 'H', 5: 'i', 6: 'I', 7: 'f', 8: 'd'}
NUMBERS = range(1, 9)
STAMP = 1_700_000_000_250_000_000


def field(name, offset, datatype):
    return SimpleNamespace(name=name, offset=offset, datatype=datatype, count=1)


def cloud(fields, rows, **given):
    """A message with `rows` of points, each a dictionary, without padding unless it is `given`."""
    step = given.get('point_step', max(f.offset + struct.calcsize(CODES[f.datatype]) for f in fields))
    row_step = given.get('row_step', step * len(rows[0]))
    data = bytearray(given.get('filler', b'\0') * (row_step * len(rows)))
    order = '>' if given.get('is_bigendian') else '<'
    for r, row in enumerate(rows):
        for k, point in enumerate(row):
            for f in fields:
                struct.pack_into(order + CODES[f.datatype], data, r * row_step + k * step + f.offset, point[f.name])
    header = SimpleNamespace(frame_id='lidar',
                             stamp=SimpleNamespace(sec=STAMP // 10**9, nanosec=STAMP % 10**9))
    return SimpleNamespace(header=header, height=len(rows), width=len(rows[0]), fields=fields, point_step=step,
                           row_step=row_step, is_bigendian=given.get('is_bigendian', False), data=bytes(data))


def random_cloud(rng, datatype):
    """A message with fields in any order, gaps between them, points that are not finite, and padded rows."""
    fields, offset = [], int(rng.integers(0, 5))
    for name in rng.permutation(['x', 'y', 'z', 'intensity', 'ring']):
        kind = datatype if name in ('x', 'y', 'z') else int(rng.choice(NUMBERS))
        fields.append(field(str(name), offset, kind))
        offset += struct.calcsize(CODES[kind]) + int(rng.integers(0, 4))
    height, width = int(rng.integers(1, 5)), int(rng.integers(1, 120))
    real = datatype >= 7
    low, high = (-20.0, 20.0) if real else (0 if datatype in (2, 4, 6) else -20, 20)
    rows = []
    for _ in range(height):
        points = rng.uniform(low, high, (width, 3)) if real else rng.integers(low, high, (width, 3))
        points[rng.random(width) < 0.1] = 0
        if real:
            points[rng.random((width, 3)) < 0.05] = rng.choice([np.nan, np.inf, -np.inf])
        rows.append([dict(zip('xyz', p.tolist(), strict=True), intensity=1, ring=2) for p in points])
    step = offset + int(rng.integers(0, 9))
    return cloud(fields, rows, point_step=step, row_step=step * width + int(rng.integers(0, 30)), filler=b'\x7f',
                 is_bigendian=bool(rng.random() < 0.5))


def random_transform(rng):
    w, x, y, z = (q := rng.normal(size=4)) / np.linalg.norm(q)
    matrix = np.eye(4)
    matrix[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                      [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                      [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    matrix[:3, 3] = rng.uniform(-1.0, 1.0, 3)
    return matrix


def by_loop(message, matrix, parameters):
    """Number of a bin -> (range, bearing) of its nearest point, point by point."""
    found = {}
    count = round(2.0 * math.pi / parameters.bearing_step)
    kinds = {f.name: ('>' if message.is_bigendian else '<') + CODES[f.datatype] for f in message.fields}
    for row in range(message.height):
        for column in range(message.width):
            at = row * message.row_step + column * message.point_step
            p = [float(struct.unpack_from(kinds[f.name], message.data, at + f.offset)[0])
                 for name in 'xyz' for f in message.fields if f.name == name]
            if not all(map(math.isfinite, p)):
                continue
            x, y, z = (sum(matrix[r, c] * p[c] for c in range(3)) for r in range(3))
            distance = math.hypot(x, y)
            if distance == 0.0 or not parameters.height_min <= z + matrix[2, 3] <= parameters.height_max:
                continue
            bearing = math.atan2(y, x)
            number = min(int((bearing + math.pi) / (2.0 * math.pi) * count), count - 1)
            found[number] = min(found.get(number, (math.inf, 0.0)), (distance, bearing))
    return count, found


@pytest.mark.parametrize('seed', range(8))
def test_a_scan_has_the_nearest_point_of_each_bin(seed):
    rng = np.random.default_rng(seed)
    message, matrix = random_cloud(rng, seed % 8 + 1), random_transform(rng)
    parameters = InputParameters(height_min=-8.0, height_max=float(rng.uniform(0.0, 12.0)),
                                 bearing_step=float(rng.uniform(0.005, 0.1)))
    scan = scan_from_cloud(message, matrix, parameters)
    count, found = by_loop(message, matrix, parameters)
    assert scan.geometry.size == count and scan.stamp == STAMP and scan.frame_id == 'lidar'
    assert set(scan.valid.nonzero()[0]) == set(found)
    assert (np.diff(scan.geometry.bearings) > 0.0).all() and scan.time_increment == 0.0
    for number, (distance, bearing) in found.items():
        assert scan.ranges[number] == pytest.approx(distance, rel=1e-6)
        assert scan.geometry.bearings[number] == pytest.approx(bearing, abs=1e-6)


def turning(times, first, sign, rows=4, beams=180):
    """Points all around, measured within 0.1 s from the bearing `first` on; `times` describes the time field."""
    name, kind, stamped = times
    fields = [field('x', 0, 7), field('y', 4, 7), field('z', 8, 7), field(name, 12, kind)]
    bearings = first + sign * 2.0 * math.pi / beams * (np.arange(beams) + 0.5)
    at = 0.1 / beams * np.arange(beams)
    return cloud(fields, [[{'x': 3.0 * math.cos(b), 'y': 3.0 * math.sin(b), 'z': 0.1 * r, name: stamped(t)}
                           for b, t in zip(bearings, at, strict=True)] for r in range(rows)])


@pytest.mark.parametrize('times, starts', [
    (('time', 7, lambda t: t - 0.1), -0.1), (('t', 6, lambda t: round(1e9 * t)), 0.0),
    (('timestamp', 8, lambda t: 1e-9 * STAMP + t - 0.05), -0.05), (('timestamp', 8, lambda t: 1e9 * t + STAMP), 0.0),
    (('timestamp', 8, lambda t: 37.0 + t), 0.0), (('offset_time', 6, lambda t: round(1e9 * t)), 0.0)])
@pytest.mark.parametrize('first, sign', [(2.1, -1), (-3.0, 1)])
def test_beams_are_in_the_order_in_which_they_were_measured(times, starts, first, sign):
    message = turning(times, first, sign)
    scan = scan_from_cloud(message, np.eye(4), InputParameters(height_min=-1.0, bearing_step=math.radians(2.0)))
    assert scan.time_increment == pytest.approx(0.1 / 180, rel=1e-3)
    assert scan.stamp == pytest.approx(STAMP + 1e9 * starts, abs=1e6)
    assert math.copysign(1.0, scan.geometry.angle_increment) == sign
    assert (np.diff(scan.geometry.bearings) * sign > 0.0).all()
    assert abs(math.remainder(scan.geometry.bearings[0] - first, 2.0 * math.pi)) < math.radians(4.0)
    assert scan.valid.all()


def test_the_time_offset_moves_stamps_of_the_points_as_well():
    """The driver's offset is in the stamp of the message already."""
    message = turning(('timestamp', 8, lambda t: 1e-9 * STAMP - 0.3 + t), 0.0, 1)
    scan = scan_from_cloud(message, np.eye(4), InputParameters(height_min=-1.0, bearing_step=math.radians(2.0),
                                                               time_offset=(0.3,)))
    assert scan.stamp == pytest.approx(STAMP, abs=1e6)


@pytest.mark.parametrize('seed', range(3))
def test_points_in_no_order_are_of_their_mean_time(seed):
    rng = np.random.default_rng(seed)
    shuffled = rng.permutation(180)
    message = turning(('offset_time', 6, lambda t: round(1e9 * 0.1 / 180 * shuffled[round(t / 0.1 * 180)])), 0.0, 1,
                      rows=1)
    scan = scan_from_cloud(message, np.eye(4), InputParameters(height_min=-1.0, bearing_step=math.radians(2.0)))
    assert scan.time_increment == 0.0 and scan.stamp == pytest.approx(STAMP + 5e7, abs=1e6)


@pytest.mark.parametrize('change, expected', [
    ({'fields': [field('x', 0, 7), field('y', 4, 7)]}, 'expected a field z'),
    ({'fields': [field('x', 0, 7), field('y', 4, 7), field('z', 8, 9)]}, 'of a point cloud has the datatype 9'),
    ({'fields': [field('x', 0, 7), field('y', 4, 7), field('z', 12, 8)]}, 'within the point_step 16'),
    ({'width': 200}, 'expected at least'), ({'row_step': 16}, 'expected at least')])
def test_messages_that_contradict_themselves_are_refused(change, expected):
    message = turning(('time', 7, float), 0.0, 1)
    vars(message).update(change)
    with pytest.raises(ScanError, match=expected):
        scan_from_cloud(message, np.eye(4), InputParameters())
