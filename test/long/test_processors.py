# SPDX-License-Identifier: Apache-2.0
"""The same drives with other instructions of the processor: no decision differs, and poses by rounding only."""
import json
import os
import platform
import subprocess
import sys

import numpy as np
import pytest

DRIVES = """
import json
from dbscan_reg_ros import Odometry
from dbscan_reg_ros.simulation import LIDARS, corridor, follow, hall, rooms, simulate
found = []
for make in (rooms, corridor, hall):
    world, odometry = make(seed=1), Odometry()
    for scan in simulate(world, follow(world.tour), LIDARS['rplidar_a'], seed=1).scans[:200]:
        update = odometry.process(scan)
        found.append([update.status.name, update.is_key_frame, *update.pose.as_tuple()])
print(json.dumps(found))
"""


def driven(root, **variables):
    """Decisions ``(N, 2)`` and poses ``(N, 3)`` of the drives, in a process of its own."""
    done = subprocess.run([sys.executable, '-W', 'ignore', '-c', DRIVES], capture_output=True, text=True, check=True,
                          env=os.environ | {'PYTHONPATH': str(root)} | variables)
    rows = json.loads(done.stdout)
    return [row[:2] for row in rows], np.array([row[2:] for row in rows])


@pytest.fixture(scope='module')
def usual(root):
    return driven(root)


@pytest.mark.skipif(platform.machine() != 'x86_64', reason='the names are those of x86-64')
@pytest.mark.parametrize('variables', [
    *({'NPY_DISABLE_CPU_FEATURES': features} for features in (
        'AVX512F AVX512CD AVX512_SKX', 'AVX512F AVX512CD AVX512_SKX AVX2', 'AVX512F AVX512CD AVX512_SKX AVX2 FMA3')),
    *({'OPENBLAS_CORETYPE': core} for core in ('Haswell', 'Nehalem')),
    {'GLIBC_TUNABLES': 'glibc.cpu.hwcaps=-AVX2_Usable,-FMA_Usable,-AVX2,-FMA,-FMA4,-AVX512F'}],
    ids=lambda variables: ''.join(variables.values()))
def test_no_decision_depends_on_the_instructions_of_the_processor(root, usual, variables):
    decisions, poses = driven(root, **variables)
    assert decisions == usual[0]
    assert np.abs(poses - usual[1]).max() < 1e-12
