# SPDX-License-Identifier: Apache-2.0
"""Warnings about wrong scan metadata: the same for a recording and in the node."""
import math
from types import SimpleNamespace

import numpy as np
import pytest

from dbscan_reg_ros.recordings.checks.scan_checks import CloudChecks, Kind, ScanChecks, ScanFields, ScanWatch

SECOND = 10**9
START = 1_700_000_000 * SECOND


def drive(count=30, period=0.1, beams=360, **changes):
    """Fields of scans in a room of a lidar that looks all round.

    A change is a value, or a function of the scan's number.
    """
    rng = np.random.default_rng(1)
    step = 2.0 * math.pi / beams
    for k in range(count):
        fields = ScanFields(START + round(k * period * SECOND), 'laser', -math.pi, -math.pi + (beams - 1) * step, step,
                            period / beams, 0.1, 12.0, rng.uniform(1.0, 6.0, beams).astype(np.float32))
        yield fields._replace(**{name: value(k) if callable(value) else value for name, value in changes.items()})


def sightings(scans):
    watch = ScanWatch()
    for fields in scans:
        watch.look(fields)
    return {sighting.warning.kind: sighting for sighting in watch.sightings}


def scaled(factor, beams=360):
    rng = np.random.default_rng(2)
    return lambda _k: (factor * rng.uniform(1.0, 6.0, beams)).astype(np.float32)


def missing(share, value, factor=1.0):
    rng = np.random.default_rng(3)
    return lambda _k: np.where(rng.uniform(size=360) < share, value,
                               factor * rng.uniform(1.0, 6.0, 360)).astype(np.float32)


JITTER = np.random.default_rng(4).integers(-60_000_000, 60_000_000, 30)


@pytest.mark.parametrize('changes', [
    {},
    {'time_increment': 0.0},
    {'time_increment': 1.1 * 0.1 / 360},
    {'stamp': lambda k: START + k * SECOND // 10 - (k % 5 == 4) * 150_000_000},
    {'stamp': lambda k: START + k * SECOND // 10 + int(JITTER[k])},
    {'stamp': lambda k: START + (k - (k == 9)) * SECOND // 10},
    {'ranges': missing(0.8, 81.83)},
    {'ranges': missing(0.8, 65.535)},
    {'ranges': missing(0.8, 1000.0)},
    {'ranges': missing(0.8, math.inf)},
    {'ranges': missing(0.8, 0.0)},
    {'ranges': missing(0.8, 0.019)},
    {'ranges': missing(1.0, math.nan)},
    {'ranges': missing(0.3, 25.0, 2.5)},
    {'range_max': 0.0},
    {'range_max': math.inf, 'ranges': scaled(15.0)},
    {'ranges': lambda k: np.linspace(1.0, 5.0, 360 + k % 9, dtype=np.float32),
     'angle_max': -math.pi + 2.0 * math.pi * 363 / 360,
     'angle_min': lambda k: -math.pi - (k % 9 - 4) * math.pi / 180},
])
def test_correct_metadata_cause_no_warning(changes):
    assert not sightings(drive(**changes)), sightings(drive(**changes))


@pytest.mark.parametrize('changes, kind, count, says', [
    ({'frame_id': lambda k: ('front', 'back')[k % 2]}, Kind.FRAME, 29, "from the frame 'front' to 'back'"),
    ({'frame_id': lambda k: ('front', 'back')[k % 2], 'stamp': lambda k: START + k // 2 * SECOND // 10}, Kind.FRAME, 29,
     'give each laser a topic'),
    ({'angle_increment': -2.0 * math.pi / 360}, Kind.ANGLE_INCREMENT, 30,
     'angle_increment is -0.0174533 rad, but angle_max 3.12414 rad lies above angle_min -3.14159 rad'),
    ({'angle_min': math.pi, 'angle_max': -math.pi + math.pi / 180}, Kind.ANGLE_INCREMENT, 30, 'lies below'),
    ({'angle_min': 1.5, 'angle_max': -1.2}, Kind.ANGLE_INCREMENT, 30,
     'angle_max -1.2 rad lies below angle_min 1.5 rad'),
    ({'angle_max': 1.0}, Kind.ANGLE_MAX, 30,
     'angle_max is 1 rad, but 360 ranges, angle_min and angle_increment end at 3.12414 rad'),
    ({'angle_max': math.nan}, Kind.ANGLE_MAX, 30, 'angle_max is nan'),
    ({'stamp': 0}, Kind.STAMP_ZERO, 29, 'the scans have no stamp'),
    ({'stamp': START}, Kind.STAMP_EQUAL, 27, 'are equal (1700000000.000 s)'),
    ({'stamp': lambda k: START + k // 2 * SECOND // 5}, Kind.STAMP_EQUAL, 13, 'are equal'),
    ({'stamp': lambda k: START + 1000 * k, 'time_increment': 0.0}, Kind.STAMP_UNIT, 27, 'are 1000 ns apart'),
    ({'stamp': lambda k: k, 'time_increment': 0.0}, Kind.STAMP_UNIT, 27, 'numbers of scans by the time'),
    ({'stamp': lambda k: START // 1000 + k * SECOND // 10_000, 'time_increment': 0.0}, Kind.STAMP_UNIT, 27,
     'are 100000 ns apart'),
    ({'stamp': lambda k: START - k * SECOND // 10}, Kind.STAMP_BACK, 26, 'go back by 0.100 s, to 1699999999.600 s'),
    ({'stamp': lambda k: START + k * SECOND // 10 - k % 2 * SECOND}, Kind.STAMP_BACK, 12,
     'expected stamps that increase'),
    ({'stamp': lambda k: START + k * SECOND // 10 - (k > 15) * 600_000_000}, Kind.CLOCK_BACK, 1, 'back by about 0.6 s'),
    ({'stamp': lambda k: START + k * SECOND // 10 - (k > 15) * 400_000_000 + int(JITTER[k] // 2)}, Kind.CLOCK_BACK, 1,
     'at 1700000001.'),
    ({'stamp': lambda k: START + k % 20 * SECOND, 'time_increment': 0.0}, Kind.STAMP_BACK, 1, 'go back by 19.000 s'),
    ({'time_increment': -1e-4}, Kind.TIME_INCREMENT, 30, 'time_increment is -0.0001 s'),
    ({'time_increment': math.inf}, Kind.TIME_INCREMENT, 30, 'time_increment is inf s'),
    ({'time_increment': 0.1}, Kind.TIME_INCREMENT, 28, '360 beams last 35.9 s, but a scan comes every 0.1 s'),
    ({'time_increment': 2.0 * 0.1 / 360}, Kind.TIME_INCREMENT, 27, '360 beams last 0.199 s'),
    ({'ranges': scaled(1000.0)}, Kind.MILLIMETRES, 30, 'range_max 12 m; expected metres'),
    ({'ranges': scaled(1000.0), 'range_min': 100.0, 'range_max': 12000.0}, Kind.MILLIMETRES, 30, 'range_max 12000 m'),
    ({'ranges': missing(0.7, 65535.0, 1000.0)}, Kind.MILLIMETRES, 30, 'look like millimetres'),
    ({'ranges': scaled(100.0)}, Kind.CENTIMETRES, 30, 'divide by 100'),
    ({'ranges': scaled(60.0)}, Kind.CENTIMETRES, 30, 'divide by 100'),
    ({'ranges': scaled(100.0), 'range_min': 10.0, 'range_max': 1200.0}, Kind.CENTIMETRES, 30, 'range_max 1200 m'),
    ({'ranges': scaled(1000.0), 'range_min': 0.0, 'range_max': 1e6}, Kind.MILLIMETRES, 30, 'divide by 1000'),
    ({'range_max': 0.12}, Kind.RANGE_MAX, 30, 'beyond range_max'),
    ({'range_max': 0.012}, Kind.RANGE_MAX, 30, 'range_min is 0.1 m, range_max 0.012 m'),
    ({'ranges': scaled(10.0)}, Kind.RANGE_MAX, 30, 'beyond range_max'),
    ({'range_min': 10.0}, Kind.RANGE_MIN, 30, 'below range_min'),
    ({'range_min': 12.0, 'range_max': 0.1}, Kind.RANGE_MIN, 30, 'range_min is 12 m, range_max 0.1 m'),
    ({'ranges': missing(0.3, 11.99)}, Kind.NO_RETURN, 25, '11.99 m'),
    ({'ranges': missing(0.3, 12.0)}, Kind.NO_RETURN, 25, '12 m'),
    ({'ranges': lambda k: np.ones(360 if k < 9 else 250, dtype=np.float32),
      'angle_max': lambda k: (-math.pi + 2.0 * math.pi * (
        359 if k < 9 else 249) / 360)}, Kind.BEAMS, 1, 'the scans change from 360 to 250 beams'),
])
def test_each_kind_is_reported_once_with_the_value_required(changes, kind, count, says):
    found = sightings(drive(**changes))
    assert list(found) == [kind], found
    assert says in found[kind].warning.text
    assert found[kind].count == count


def test_a_stamp_in_the_future_needs_a_clock():
    fields = next(drive())
    assert not ScanChecks().look(fields)
    warning, = ScanChecks().look(fields, START - 5 * SECOND)
    assert (warning.kind, '5.0 s in the future' in warning.text) == (Kind.STAMP_FUTURE, True)


def test_after_a_restart_stamps_may_be_any():
    checks = ScanChecks()
    scans = list(drive(10))
    for fields in scans:
        checks.look(fields)
    checks.restart()
    assert not checks.look(scans[0]._replace(stamp=SECOND))


def test_damaged_numbers_are_looked_at_without_a_warning():
    bits = np.array([0x7f800001, 0xffa00000, 0x7fc00000, 0x7f7fffff, 0x00000001, 0x80000000], dtype=np.uint32)
    assert sightings(drive(ranges=lambda _k: np.resize(bits, 360).view(np.float32))).keys() <= {Kind.MILLIMETRES}


# Point clouds

def cloud_of(points):
    """The message of a lidar with the `points` (N, 3)."""
    fields = [SimpleNamespace(name=name, offset=4 * k, datatype=7) for k, name in enumerate('xyz')]
    header = SimpleNamespace(frame_id='camera', stamp=SimpleNamespace(sec=1, nanosec=0))
    return SimpleNamespace(header=header, height=1, width=len(points), fields=fields, is_bigendian=False, point_step=12,
                           row_step=12 * len(points), data=np.asarray(points, dtype='<f4').tobytes())


OPTICAL = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Turns points with x forward and z up to those of a camera: x to the right, y down, z forward."""


@pytest.mark.parametrize('factor, turn, mounted, kinds', [
    (1.0, np.eye(3), np.eye(3), []), (1000.0, np.eye(3), np.eye(3), [Kind.MILLIMETRES]),
    (100.0, np.eye(3), np.eye(3), [Kind.CENTIMETRES]), (1.0, OPTICAL, np.eye(3), [Kind.OPTICAL_FRAME]),
    (1.0, OPTICAL, OPTICAL.T, [])])
def test_the_unit_and_the_axes_of_point_clouds_are_checked(factor, turn, mounted, kinds):
    rng, matrix = np.random.default_rng(1), np.eye(4)
    distance, across, up = rng.uniform(1.0, 6.0, 500), rng.uniform(-0.5, 0.5, 500), rng.uniform(-0.4, 0.4, 500)
    points = factor * distance[:, None] * np.column_stack((np.ones(500), across, up)) @ turn.T
    matrix[:3, :3] = mounted
    checks = CloudChecks()
    first, again = (checks.look(cloud_of(points), matrix) for _ in range(2))
    assert [warning.kind for warning in first] == kinds and again == first
