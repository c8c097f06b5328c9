# SPDX-License-Identifier: Apache-2.0
"""Python warnings about the scans that a program makes of arrays."""
import warnings

import numpy as np
import pytest

from dbscan_reg_ros import Odometry, Scan, ScanError, register

SECOND = 10**9
LIMITS = {'range_min': 0.1, 'range_max': 12.0}


def processed(scans, factor=1.0, stamp=lambda k: SECOND + k * SECOND // 10, **limits):
    """Texts of the warnings while an odometry processes scans that are made of arrays."""
    odometry = Odometry()
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter('always')
        for k, scan in enumerate(scans[:12]):
            made = Scan.from_ranges(factor * scan.ranges, scan.geometry.bearings, stamp=stamp(k), **limits)
            try:
                odometry.process(made)
            except ScanError:
                continue
    assert {warning.filename for warning in found} <= {__file__}
    return [str(warning.message) for warning in found]


@pytest.mark.parametrize('changes, says', [
    ({'factor': 1000.0}, 'look like millimetres'), ({'factor': 1000.0, **LIMITS}, 'divide by 1000'),
    ({'factor': 100.0, **LIMITS}, 'look like centimetres'),
    ({'range_min': 12.0, 'range_max': 0.1}, 'range_min is 12 m'),
    ({'stamp': lambda k: 1_700_000_000_000 + 100 * k}, 'are 100 ns apart'),
    ({'stamp': lambda k: 1_700_000_000_000_000 + 100_000 * k}, 'are 100000 ns apart'),
    ({'stamp': lambda _: 0}, 'no motion can be estimated'),
    ({'stamp': lambda _: 7 * SECOND}, 'are equal (7.000 s)'),
    ({'stamp': lambda k: (9 - k) * SECOND // 10 + 10 * SECOND}, 'go back by 0.100 s')])
def test_an_odometry_warns_once_of_each_kind_of_fault(scans, changes, says):
    text, = processed(scans, **changes)
    assert says in text


def test_sound_scans_cause_no_warning_and_may_start_at_0(scans):
    assert processed(scans, **LIMITS) == processed(scans, stamp=lambda k: k * SECOND // 10) == []


def test_a_registration_warns_of_ranges_but_needs_no_stamps(scans):
    pair = [Scan.from_ranges(scan.ranges, scan.geometry.bearings) for scan in scans[:2]]
    found = register(*pair)  # warnings are errors
    in_millimetres = [Scan.from_ranges(1000.0 * np.asarray(each.ranges), each.geometry.bearings) for each in pair]
    with pytest.warns(UserWarning, match='look like millimetres') as warned:
        register(*in_millimetres)
    assert len(warned) == 1 and found.overlap > 0.5
