# SPDX-License-Identifier: Apache-2.0
"""Scans with every field at its worst: named errors, finite answers, and bounded time and memory."""
import time
from collections import Counter

import numpy as np
import pytest
from child import in_child
from worst_scans import worst_scan

from dbscan_reg_ros import Odometry, Scan, ScanError, Status

pytestmark = pytest.mark.filterwarnings('ignore::UserWarning')
SEQUENCE = 20
"""Scans that one odometry sees."""
MEMORY = 512 * 2**20
HARMFUL = 60, 6735, 500_284
"""Sequences that once ended in a warning or an error."""
LONGEST = 2.0
"""CPU time that any one scan may take [s]."""


def sequences(count, huge=0.0, first=0):
    """The seeds and messages of `count` scans, in sequences."""
    for seed in range(first, first + count // SEQUENCE):
        yield seed, messages(seed, huge)


def messages(seed, huge=0.0):
    rng = np.random.default_rng(seed)
    return [worst_scan(rng, index, huge) for index in range(SEQUENCE)]


def process(odometry, message):
    """The update, or None for a scan that is refused by name; anything else is an error."""
    try:
        return odometry.process(Scan.from_message(message))
    except ScanError as error:
        assert str(error)
        return None


def check(update):
    assert np.isfinite(update.pose.as_array()).all()
    assert np.isfinite(update.twist).all()
    for covariance in (update.covariance, update.twist_covariance):
        assert np.isfinite(covariance).all()
        assert np.allclose(covariance, covariance.T, rtol=1e-9)
        assert np.linalg.eigvalsh(covariance)[0] > 0.0
    if update.registration:
        assert 0.0 <= update.registration.overlap <= 1.0
        assert np.isfinite(update.registration.covariance).all()
        assert update.registration.reason or update.registration.status is Status.OK


def follow(seed):
    """Number of scans of a sequence for each status, and of those refused."""
    odometry, outcomes = Odometry(), Counter()
    for index, message in enumerate(messages(seed)):
        try:
            update = process(odometry, message)
            if update:
                check(update)
        except Exception as error:
            raise AssertionError(f'scan {index} of sequence {seed}') from error
        outcomes[update.status if update else 'refused'] += 1
    return outcomes


@pytest.mark.parametrize('seed', HARMFUL)
def test_scans_that_once_did_harm_do_none(seed):
    assert follow(seed).total() == SEQUENCE


def test_any_scan_is_answered_or_refused_by_name(size):
    outcomes = sum((follow(seed) for seed in range(size(1000, 200_000) // SEQUENCE)), Counter())
    print(outcomes)
    assert all(outcomes[outcome] > 0 for outcome in (*Status, 'refused')), 'too tame: an outcome never came'


def test_a_scan_that_is_refused_changes_nothing(size):
    """The odometry goes on to the last bit as one that never saw the refused scans."""
    refused = 0
    for seed, worst in sequences(size(400, 20_000), first=10**6):
        disturbed, spared = Odometry(), Odometry()
        for message in worst:
            update = process(disturbed, message)
            if update is None:
                refused += 1
                continue
            expected = process(spared, message)
            assert (update.pose, update.status) == (expected.pose, expected.status), f'sequence {seed}'
            assert (update.covariance == expected.covariance).all() and (update.twist == expected.twist).all()
    assert refused


def slowest(count):
    """Maximum CPU time [s] of `count` scans, many of them with far too many beams; its sequence and index."""
    worst = 0.0, None
    for seed, many in sequences(count, huge=0.3, first=2 * 10**6):
        odometry = Odometry()
        for index, message in enumerate(many):
            begin = time.thread_time()
            process(odometry, message)
            worst = max(worst, (time.thread_time() - begin, (seed, index)))
    return worst


def test_scans_of_far_too_many_beams_take_bounded_time_and_memory(size):
    count = size(60, 4000)
    (seconds, where), memory = in_child(slowest, count, timeout=60 + count * LONGEST)
    assert seconds < LONGEST, f'sequence and index {where}'
    assert memory < MEMORY
