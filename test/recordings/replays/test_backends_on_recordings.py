# SPDX-License-Identifier: Apache-2.0
"""Both backends on recordings: scan by scan from the same state, and each on its own."""
import copy
import dataclasses
import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks.registration import backends as benchmark

from dbscan_reg_ros import Odometry, ScanError, open_recording
from dbscan_reg_ros.core.backend import REFERENCE
from dbscan_reg_ros.core.odometry.mapping.key_frame_window import KeyFrameWindow

RECORDINGS = 'intel/intel.log.gz', 'aces/aces.log.gz', 'urg04lx/exp1', 'ccny_demo/demo.bag', 'lms511/static'


def scans(data, name, count):
    return itertools.islice(open_recording(data / name).scans(), count)


def window_of(window, backend):
    """The same key frames, whose tables the other backend makes."""
    return KeyFrameWindow([dataclasses.replace(frame, features=dataclasses.replace(frame.features, backend=backend))
                           for frame in window.frames])


def processed(odometry, scan):
    try:
        return odometry.process(scan)
    except ScanError as error:
        return str(error)


@pytest.mark.parametrize('name', RECORDINGS)
def test_from_the_same_state_both_give_the_same(data, compiled, size, name):
    """Poses and covariances within 1e-8, twists (by intervals from 10 ms on) 1e-6; equal status and key frames."""
    one, other = Odometry(backend=REFERENCE), Odometry(backend=compiled)
    window = None
    for scan in scans(data, name, size(60, 2000)):
        state = one._state
        if state.window is not None and (window is None or window[0] is not state.window):
            window = state.window, window_of(state.window, compiled)
        shared = {id(part): part for part in (state.window, state.tracking) if part is not None}
        other._state = copy.deepcopy(state, shared)
        if window is not None:
            other._state.window = window[1]
        found, compared = processed(one, scan), processed(other, scan)
        if isinstance(found, str):
            assert compared == found
            continue
        assert (compared.status, compared.reference_changed) == (found.status, found.reference_changed), found
        for part, most in (('covariance', 1e-8), ('twist', 1e-6), ('twist_covariance', 1e-6)):
            np.testing.assert_allclose(getattr(compared, part), getattr(found, part), rtol=1e-7, atol=most)
        np.testing.assert_allclose(compared.pose.as_array(), found.pose.as_array(), atol=1e-8)


def test_on_its_own_each_stays_within_a_millimetre(data, compiled, size):
    odometries = [Odometry(backend=backend) for backend in (REFERENCE, compiled)]
    for scan in scans(data, 'intel/intel.log.gz', size(300, 10_000)):
        one, other = (odometry.process(scan) for odometry in odometries)
        assert (one.status, one.reference_changed) == (other.status, other.reference_changed)
        np.testing.assert_allclose(other.pose.as_array(), one.pose.as_array(), atol=1e-3)


def test_the_benchmark_times_both_in_turns(data, compiled, monkeypatch):
    monkeypatch.setattr(benchmark, 'BEAMS', (181,))
    report = benchmark.measure(SimpleNamespace(data=str(data), limit=4))
    assert set(report.metrics) == {'pairs_180', 'intel_180', 'rooms_181'} and not report.missed
    for row in report.metrics.values():
        assert row['ratio_median'] > 0.0 and row['largest_difference_m'] < 1e-6
