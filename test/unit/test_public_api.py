# SPDX-License-Identifier: Apache-2.0
"""What ``from dbscan_reg_ros import ...`` gives.

Names, scans from arrays, registration of scans, records in one line.
"""
import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rooms import FULL, L_ROOM, look, outline, room_log

import dbscan_reg_ros
from dbscan_reg_ros import (
    SE2,
    ArgumentError,
    Localizer,
    Odometry,
    ParameterError,
    Parameters,
    Prior,
    Scan,
    ScanError,
    ScanGeometry,
    Status,
    extract_features,
    open_recording,
    register,
    write_tum,
)
from dbscan_reg_ros.command_lines import version
from dbscan_reg_ros.core.paper.pipeline import register as register_by_paper
from dbscan_reg_ros.core.sensor import Sensor
from dbscan_reg_ros.figures.plots import plot_map
from dbscan_reg_ros.recordings import read_tum
from dbscan_reg_ros.robot.parameters import NodeParameters

PROMISED = {'Scan', 'extract_features', 'register', 'Odometry', 'Parameters', 'SE2', 'Status', 'open_recording',
            'Recording', 'write_tum', 'DbscanRegError', 'ArgumentError', 'ParameterError', 'RecordingError',
            'ScanError'}
ANGLES = np.linspace(-math.pi, math.pi, 360, endpoint=False)
RANGES = np.linspace(1.0, 5.0, 360)


# Names

def test_every_public_name_is_there_and_listed():
    assert set(dbscan_reg_ros.__all__) >= PROMISED
    assert set(dir(dbscan_reg_ros)) == {*dbscan_reg_ros.__all__, '__doc__', '__version__'}
    assert dbscan_reg_ros.__version__ == version()
    for name in dbscan_reg_ros.__all__:
        assert getattr(dbscan_reg_ros, name).__name__ == name


# Scans from arrays

def test_a_scan_from_arrays_is_that_of_a_message():
    for geometry in (FULL, ScanGeometry(-1.5, 0.01, 200, 0.1, 12.0), ScanGeometry(1.5, -0.01, 200, 0.1, 12.0)):
        scan = Scan(7, np.linspace(0.05, 13.0, geometry.size), geometry, 1e-4)
        made = Scan.from_ranges(scan.ranges, geometry.bearings, stamp=np.int64(7), range_min=geometry.range_min,
                                range_max=geometry.range_max, time_increment=1e-4)
        assert (made.stamp, made.time_increment, made.geometry) == (7, scan.time_increment, geometry)
        assert type(made.stamp) is int
        np.testing.assert_array_equal(made.points, scan.points)


def test_angles_may_jump_from_pi_to_minus_pi():
    rolled = Scan.from_ranges(np.roll(RANGES, 100), np.roll(ANGLES, 100))
    assert rolled.geometry.bearings_given is None
    np.testing.assert_allclose(np.roll(rolled.points, -100, axis=0), Scan.from_ranges(RANGES, ANGLES).points, atol=1e-5)


@given(st.integers(0, 2**32 - 1), st.sampled_from([1.0, -1.0]))
def test_jitter_of_the_beams_is_kept(seed, sign):
    angles = sign * (ANGLES + np.random.default_rng(seed).uniform(-0.2, 0.2, 360) * (ANGLES[1] - ANGLES[0]))
    scan = Scan.from_ranges(RANGES, angles)
    np.testing.assert_allclose(scan.geometry.bearings, angles, atol=1e-6)
    assert scan.geometry.angle_increment == pytest.approx(sign * math.radians(1.0), rel=0.05)


def changed(values, place, value):
    values = values.copy()
    values[place] = value
    return values


@pytest.mark.parametrize(('ranges', 'angles', 'words'), [
    (RANGES[:-1], ANGLES, '359 ranges for 360 angles: expected one angle for each range'),
    (RANGES[None], ANGLES, r'ranges of shape \(1, 360\); expected one number for each beam, shape \(N,\)'),
    (RANGES, ANGLES[:, None], r'angles of shape \(360, 1\); expected'),
    (3.0, ANGLES, r'ranges of shape \(\); expected'),
    ([], [], '0 angles; expected one for each beam of a scan, at least 2'),
    ([1.0], [0.0], '1 angles; expected'),
    ([[1.0], [1.0, 2.0]], ANGLES, 'ranges in rows of different lengths; expected'),
    (['near'] * 360, ANGLES, 'ranges of type <U4; expected real numbers'),
    (RANGES, None, 'angles of type object; expected real numbers'),
    (RANGES + 1j, ANGLES, 'ranges of type complex128; expected real numbers'),
    (RANGES, changed(ANGLES, 7, math.nan),
     r'angles\[7\] = nan; expected finite angles \[rad\], also for beams without a return'),
    (RANGES, changed(ANGLES, 0, -math.inf), r'angles\[0\] = -inf; expected finite'),
    (RANGES, np.random.default_rng(0).permutation(ANGLES),
     r'out of order; sort ranges and angles by angle: order = numpy.argsort'),
    (RANGES, changed(ANGLES, [7, 8], ANGLES[[8, 7]]),
     r'angles\[7\] = -3\.0\d+ and angles\[8\] = -3\.0\d+ are out of order'),
    (RANGES, np.zeros(360), r'angles\[0\] = 0 and angles\[1\] = 0 are out of order'),
    (np.delete(RANGES, 5), np.delete(ANGLES, 5),
     r'angles\[4\] and angles\[5\] are 2 times as far apart as most; .* keep the beams '
     'without a return, with the range inf'),
    (RANGES, np.degrees(ANGLES), 'angles are in radians'),
])
def test_arrays_that_are_no_scan_are_named(ranges, angles, words):
    with pytest.raises(ScanError, match=words):
        Scan.from_ranges(ranges, angles)


@pytest.mark.parametrize('stamp', [12.5, 1.7e9, np.float64(3.0), '12', None])
def test_a_stamp_in_seconds_is_refused(stamp):
    with pytest.raises(ScanError, match=r'expected whole nanoseconds \(int\); from seconds: round\(seconds \* 1e9\)'):
        Scan.from_ranges(RANGES, ANGLES, stamp=stamp)
    with pytest.raises(ScanError, match='stamp = '):
        Scan(stamp, RANGES, FULL)


def test_limits_that_are_no_numbers_are_refused():
    with pytest.raises(ScanError, match="'far': expected numbers"):
        Scan.from_ranges(RANGES, ANGLES, range_max='far')


# Scans from points

@pytest.fixture(scope='module')
def points():
    """What a lidar measures of a room, in the order of its beams."""
    return look(outline(L_ROOM), SE2(0.3, 0.2, 0.4), noise=0.005).points


def test_points_in_any_order_are_the_scan_of_the_sorted_ones(points):
    rng = np.random.default_rng(3)
    for measured in (points, points[::-1], np.roll(points, 100, axis=0), rng.permutation(points)):
        found = register(look(outline(L_ROOM)), Scan.from_points(measured)).transform
        assert tuple(found) == pytest.approx((0.3, 0.2, 0.4), abs=0.005)
    shuffled = np.vstack((rng.permutation(points), [(math.nan, 1.0)]))
    scan = Scan.from_points(shuffled, stamp=7, range_min=1.0, range_max=3.0)
    assert (scan.stamp, scan.geometry.size, scan.geometry.range_min, scan.geometry.range_max) == (7, 360, 1.0, 3.0)
    assert (np.diff(scan.geometry.bearings) > 0.0).all()
    np.testing.assert_array_equal(scan.valid, (scan.ranges >= 1.0) & (scan.ranges < 3.0))
    assert Scan.from_points(points[::-1]).geometry.angle_increment == pytest.approx(-math.radians(1.0), rel=0.01)


def test_points_that_are_no_scan_are_named(points):
    with pytest.raises(ScanError, match=r'points of shape \(2, 360\); expected one point \(x, y\) in each row'):
        Scan.from_points(points.T)
    with pytest.raises(ScanError, match=r'not in the order of their bearings, but their time_increment is 0\.001'):
        Scan.from_points(np.random.default_rng(3).permutation(points), time_increment=1e-3)
    assert Scan.from_points(points, time_increment=1e-3).duration == pytest.approx(0.36)


# Arguments of a wrong kind

@pytest.mark.parametrize(('call', 'error', 'words'), [
    (lambda _: Prior((0, 0, 0), np.eye(3)), ArgumentError, 'transform is of type tuple; expected SE2'),
    (lambda _: Prior(SE2(), np.eye(2)), ArgumentError, r'shape \(2, 2\): expected \(3, 3\)'),
    (lambda _: Prior(SE2(), np.zeros((3, 3))), ArgumentError, 'expected a positive definite matrix'),
    (lambda _: Prior(SE2(), np.diag((1.0, 1.0, -1.0))), ArgumentError, 'expected a positive definite matrix'),
    (lambda _: Prior(SE2(), np.full((3, 3), math.nan)), ArgumentError, 'expected a positive definite matrix'),
    (lambda _: Prior(SE2(), np.diag((1.0, 1.0, math.inf))), ArgumentError, 'expected a positive definite matrix'),
    (lambda _: Prior(SE2(), np.eye(3) + np.eye(3, k=1) / 2), ArgumentError, 'expected a symmetric matrix'),
    (lambda _: Odometry({'scan.range_max': 9.0}), ParameterError, 'of type dict; expected Parameters'),
    (lambda _: Odometry('lds.yaml'), ParameterError, r'of type str; .* read_parameters\(FILE\)'),
    (lambda scan: register(scan, scan, {}), ParameterError, 'of type dict; expected Parameters'),
    (lambda scan: register(scan, scan, parameters=None), ParameterError, 'of type NoneType; expected Parameters'),
    (lambda scan: register(scan, scan, prior=SE2()), ArgumentError, 'prior is of type SE2; expected Prior'),
    (lambda scan: extract_features(scan, {}), ParameterError, 'of type dict; expected Parameters'),
    (lambda scan: extract_features(scan.ranges), ScanError, 'of type ndarray; expected Scan.from_ranges'),
    (lambda scan: Odometry().process(scan.ranges), ScanError, 'of type ndarray; expected Scan.from_ranges'),
    (lambda scan: Odometry().process(scan, SE2()), ArgumentError, 'prior is of type SE2; expected Prior'),
    (lambda scan: Odometry().process(scan, None, 'rear'), ArgumentError, 'sensor is of type str; expected Sensor'),
    (lambda _: Odometry().reset((1.0, 2.0, 3.0)), ArgumentError, 'pose is of type tuple; expected SE2'),
    (lambda _: Sensor('rear', (0.0, 0.0, 3.14)), ArgumentError, 'pose is of type tuple; expected SE2'),
    (lambda _: Localizer('map.npz'), ArgumentError, r'known is of type str; expected Map\.load\(FILE\)'),
    (lambda _: write_tum('a.tum', [1, 2]), ArgumentError, 'stamps without poses'),
    (lambda _: write_tum('a.tum', [SE2(), SE2()]), ArgumentError, 'poses in place of the stamps'),
    (lambda _: write_tum('a.tum', np.zeros((2, 3)), [1, 2]), ArgumentError, 'poses in place of the stamps'),
    (lambda scan: plot_map('a.png', [scan] * 2, np.zeros((3, 3))), ArgumentError, '3 poses, but fewer scans'),
    (lambda scan: plot_map('a.png', [scan] * 2, np.zeros((1, 3))), ArgumentError, '1 poses, but more scans'),
    (lambda _: write_tum('a.tum', [1, 2], np.zeros((3, 3))), ArgumentError, r'shape \(3, 3\) for 2 stamps'),
    (lambda _: write_tum('a.tum', [1, 2], np.zeros((3, 2))), ArgumentError, r'shape \(3, 2\) for 2 stamps'),
    (lambda _: write_tum('a.tum', [1.5], np.zeros((1, 3))), ScanError, 'expected whole nanoseconds'),
    (lambda _: Scan(0, RANGES, None), ScanError, 'geometry is of type NoneType; expected ScanGeometry'),
])
def test_arguments_of_a_wrong_kind_are_named(pair, tmp_path, monkeypatch, call, error, words):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error, match=words):
        call(pair[0])
    assert list(tmp_path.iterdir()) == []


# Recordings and trajectories

def test_a_recording_says_what_it_is_and_how_long(tmp_path):
    recording = open_recording(room_log(tmp_path / 'room.log', 5))
    assert repr(recording) == f"CarmenLog('{tmp_path / 'room.log'}', 5 scans on FLASER)"
    assert len(recording) == len(list(recording.scans())) == 5


def test_the_updates_of_an_odometry_are_a_trajectory(pair, tmp_path):
    odometry = Odometry()
    updates = [odometry.process(dataclasses.replace(scan, stamp=k * 10**8)) for k, scan in enumerate(pair)]
    write_tum(tmp_path / 'a.tum', updates)
    write_tum(tmp_path / 'b.tum', [each.stamp for each in updates], [each.pose for each in updates])
    assert (tmp_path / 'a.tum').read_text() == (tmp_path / 'b.tum').read_text()
    stamps, poses = read_tum(tmp_path / 'a.tum')
    assert stamps.tolist() == [0, 10**8]
    np.testing.assert_allclose(poses, [each.pose for each in updates], atol=1e-9)


# Registration of scans

def test_the_method_of_the_paper_is_not_judged(pair):
    found = register_by_paper(*pair)
    assert found.status is Status.OK and not found.judged
    assert ', not judged, ' in repr(found) and 'confidence' not in repr(found)
    assert register(*pair).judged and ', confidence 1.00' in repr(register(*pair))


def test_the_lines_of_the_readme_run(root, pair, capsys):
    block = (root / 'README.md').read_text().partition('```python\n')[2].partition('```')[0]
    exec(block, {'angles': FULL.bearings, 'ranges_1': pair[0].ranges, 'ranges_2': pair[1].ranges})
    assert capsys.readouterr().out == f'{register(*pair)!r}\n'


@pytest.fixture(scope='module')
def pair():
    return look(outline(L_ROOM)), look(outline(L_ROOM), SE2(0.2, -0.1, 0.15), seed=1)


def test_scans_are_registered_as_their_features_are(pair):
    parameters = Parameters().replace({'scan.range_max': 6.0})
    features = [extract_features(scan, parameters) for scan in pair]
    expected = register(*features, parameters)
    for arguments in (pair, (features[0], pair[1]), (pair[0], features[1])):
        found = register(*arguments, parameters)
        assert found.transform == expected.transform
        np.testing.assert_array_equal(found.covariance, expected.covariance)
    error = SE2(0.2, -0.1, 0.15).inverse() @ expected.transform
    assert math.hypot(error.x, error.y) < 0.02 and abs(error.theta) < 0.01


# Records in one line

def test_records_are_shown_in_one_line(pair):
    features = extract_features(pair[0])
    odometry = Odometry()
    updates = [odometry.process(dataclasses.replace(scan, stamp=k * 10**8)) for k, scan in enumerate(pair)]
    uneven = Scan.from_ranges(RANGES, ANGLES + 0.2 * math.radians(1.0) * np.sin(np.arange(360)))
    records = [pair[0], uneven, uneven.geometry, features, features.segments, register(*pair), Prior(SE2(), np.eye(3)),
               *updates]
    for record in records:
        text = repr(record)
        assert text.startswith(f'{type(record).__name__}(') and '\n' not in text
        assert len(text) < 250, text


def test_parameters_show_what_differs_from_the_defaults():
    assert repr(Parameters()) == 'Parameters()'
    changed = Parameters().replace({'scan.range_max': 12.0, 'odometry.reference': 'keyframe'})
    assert repr(changed) == "Parameters().replace({'scan.range_max': 12.0, 'odometry.reference': 'keyframe'})"
    assert eval(repr(changed)) == changed
    assert repr(NodeParameters().replace({'odom_frame': 'map'})) == "NodeParameters().replace({'odom_frame': 'map'})"
