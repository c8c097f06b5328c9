# SPDX-License-Identifier: Apache-2.0
"""Memory that is freed and taken again."""
import os
import platform
import subprocess
import sys

import pytest

ROUNDS = """
import resource
import numpy as np
from dbscan_reg_ros.allocation import keep_freed_memory
{call}
def faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(3):
    begin = faults()
    for _ in range(100):
        arrays = [np.ones(50_000) for _ in range(8)]
        del arrays
print(faults() - begin)
"""


def faults(root, call, **variables):
    environment = {name: value for name, value in os.environ.items() if not name.startswith(('MALLOC_', 'GLIBC_'))}
    return int(subprocess.run([sys.executable, '-c', ROUNDS.format(call=call)], cwd=root, env=environment | variables,
                              capture_output=True, text=True, check=True).stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != 'glibc', reason='the settings are those of glibc')
def test_what_is_freed_is_kept_unless_the_environment_has_its_say(root):
    kept = faults(root, 'keep_freed_memory()')
    given_back = faults(root, 'keep_freed_memory()', MALLOC_TRIM_THRESHOLD_='131072', MALLOC_MMAP_THRESHOLD_='131072')
    assert kept < 1000 < 10_000 < given_back
