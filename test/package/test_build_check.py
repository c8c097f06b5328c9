# SPDX-License-Identifier: Apache-2.0
"""Compiled modules that are missing or of other sources are named in one line; what is loaded when."""
import os
import shutil
import subprocess
import sys

import pytest

PACKAGE = 'dbscan_reg_ros'
REMEDY = 'python setup.py build_ext --inplace --force'


@pytest.fixture(params=['changed', 'missing'])
def copy(root, tmp_path, request):
    """A folder with the package, of which a source has changed since the build, or which is not built."""
    built = ('*.so',) if request.param == 'missing' else ()
    shutil.copytree(root / PACKAGE, tmp_path / PACKAGE, ignore=shutil.ignore_patterns('__pycache__', *built))
    if request.param == 'changed':
        with open(tmp_path / PACKAGE / 'core' / 'features' / 'noise.pyx', 'a') as source:
            source.write('# changed\n')
    shutil.copy(root / 'package.xml', tmp_path)
    return tmp_path


@pytest.mark.parametrize('words', [
    ['-m', PACKAGE, 'replay', 'a.log'], ['-c', 'from dbscan_reg_ros import register'],
    ['-m', PACKAGE, 'scan_matcher']], ids=['command', 'import', 'node'])
def test_a_build_that_does_not_fit_is_one_line(copy, words):
    if words[-1] == 'scan_matcher':
        pytest.importorskip('rclpy', reason='needs ROS 2')
    done = subprocess.run([sys.executable, *words], cwd=copy, env=os.environ | {'PYTHONPATH': str(copy) + os.pathsep
                          + os.environ.get('PYTHONPATH', '')}, capture_output=True, text=True, check=False, timeout=60)
    last = done.stderr.splitlines()[-1]
    assert done.returncode == 1 and REMEDY in last and str(copy) in last
    assert words[0] == '-c' or done.stderr.count('\n') == 1


def test_the_help_needs_no_build(copy):
    for words in (['--help'], ['replay', '--help'], ['--version']):
        subprocess.run([sys.executable, '-m', PACKAGE, *words], cwd=copy, check=True, capture_output=True, timeout=60,
                       env=os.environ | {'PYTHONPATH': str(copy)})
