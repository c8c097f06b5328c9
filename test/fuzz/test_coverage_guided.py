# SPDX-License-Identifier: Apache-2.0
"""A coverage-guided fuzzer on the readers and the core, in the long form only."""
import importlib.util
import shutil
import struct
import subprocess
import sys

import pytest
from bags import every_format
from rooms import FULL, L_ROOM, look, outline

from dbscan_reg_ros.robot.parameter_files import DEFAULTS_FILE

RUNS = {'scan': 20_000, 'parameters': 20_000, 'log': 20_000, 'bag': 2000, 'mcap': 2000, 'db3': 500}
AT_A_TIME = 5000
"""Inputs a process: of each scan the fuzzer itself keeps 25 kB, which counts in its limit of memory."""
FILES = {'log': 'log.log', 'bag': 'log.bag', 'mcap': 'mcap/mcap.mcap', 'db3': 'db3/db3.db3'}


@pytest.fixture(scope='module')
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp('recordings')
    every_format(folder, scans=2)
    return folder


@pytest.mark.parametrize('target', RUNS)
def test_no_input_that_reaches_something_new_does_harm(request, root, recordings, tmp_path, target):
    if not request.config.getoption('--long'):
        pytest.skip('for the long form (--long)')
    if not importlib.util.find_spec('atheris'):
        pytest.skip('needs atheris: pip install --require-hashes -r scripts/requirements/fuzz.txt')
    corpus = tmp_path / 'corpus'
    corpus.mkdir()
    if target == 'scan':
        fields = 100, 0, FULL.angle_min, 0.0, FULL.angle_increment, 0.0, 0.1, 0.0, 30.0
        (corpus / 'room').write_bytes(struct.pack('<iI7f', *fields) + look(outline(L_ROOM)).ranges.tobytes())
    else:
        shutil.copyfile(recordings / FILES[target] if target in FILES else DEFAULTS_FILE, corpus / 'whole')
    runs = min(RUNS[target], AT_A_TIME)
    for seed in range(1, RUNS[target] // runs + 1):
        result = subprocess.run([sys.executable, root / 'test' / 'coverage_guided.py', target, str(runs), str(seed),
                                 corpus],
                                cwd=tmp_path, env={'PYTHONPATH': str(root)}, capture_output=True, text=True,
                                check=False)
        assert result.returncode == 0, result.stdout[-3000:] + result.stderr[-3000:]
        assert f'Done {runs} runs' in result.stderr
