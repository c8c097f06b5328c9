# SPDX-License-Identifier: Apache-2.0
"""The build of the compiled modules; where something is missing, one line says what to install."""
import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from dbscan_reg_ros import build_check

PACKAGE = 'dbscan_reg_ros'
NO_CYTHON = {'WITHOUT_PACKAGES': 'Cython'}
BUILD = sys.executable, 'setup.py', '-q', 'build_ext', '--inplace'


@pytest.fixture(scope='module')
def cython(tools):
    """A folder to import Cython from, where there is a compiler as well."""
    if shutil.which('cc') is None or not Path(sysconfig.get_paths()['include'], 'Python.h').exists():
        pytest.skip('needs a C compiler and the headers of Python')
    if importlib.util.find_spec('setuptools') is None:
        pytest.skip('needs setuptools')
    if not (tools / 'Cython').exists() and importlib.util.find_spec('Cython') is None:
        pytest.skip('needs Cython, which scripts/test installs in build/tools')
    return tools


@pytest.fixture(scope='module')
def attempt(root, cython):
    """``attempt(words, folder, **environment)``: the result of a command; Cython can be imported, or not."""
    def attempt(words, folder, **environment):
        path = [str(root / 'test' / 'without'), str(cython), environment.pop('PYTHONPATH', '')]
        environment = os.environ | {'PYTHONPATH': os.pathsep.join(path), 'CFLAGS': '-O0'} | environment
        return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, timeout=500,
                              check=False)
    return attempt


@pytest.fixture(scope='module')
def run(attempt):
    """``run(words, folder, **environment)``: what a command prints that succeeds."""
    def run(*arguments, **environment):
        result = attempt(*arguments, **environment)
        assert result.returncode == 0, result.stdout + result.stderr
        return result.stdout
    return run


@pytest.fixture
def source(copied, tmp_path):
    """A copy of the tree, with the C of all modules, and nothing compiled."""
    folder = copied(tmp_path / PACKAGE, tmp_path / PACKAGE / 'build')
    for library in (folder / 'build').glob('lib.*'):
        shutil.rmtree(library)
    return folder


@pytest.mark.parametrize(('environment', 'remedy'), [
    (NO_CYTHON, 'apt-get install cython3'), ({'CC': 'no-such-compiler'}, 'pip install ziglang')],
    ids=['no Cython', 'no compiler'])
def test_what_a_build_lacks_is_its_last_line(source, attempt, environment, remedy):
    done = attempt(BUILD, source, **environment)
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert last.startswith(f'{PACKAGE}: its compiled modules ') and remedy in last


def test_without_the_headers_of_python_the_last_line_names_them(source, attempt, tmp_path):
    code = (f"import sys, sysconfig; paths = sysconfig.get_paths; sys.argv = ['setup.py', '-q', 'build_ext']\n"
            f"sysconfig.get_paths = lambda *given: paths(*given) | {{'include': {str(tmp_path)!r}}}\n"
            "import runpy; runpy.run_path('setup.py')")
    done = attempt([sys.executable, '-c', code], source, CC='false')
    assert done.returncode == 1 and 'apt-get install python3-dev' in done.stderr.splitlines()[-1]


def test_setup_prints_nothing_of_its_own_and_needs_neither_cython_nor_a_compiler(source, run):
    """Colcon runs it to learn the name, and ignores the package otherwise."""
    missing = NO_CYTHON | {'CC': 'no-such-compiler'}
    assert run([sys.executable, 'setup.py', '--name'], source, **missing) == f'{PACKAGE}\n'
    run([sys.executable, 'setup.py', '-q', 'egg_info'], source, **missing)


def test_setup_and_package_agree_on_the_hash_of_the_sources(source, run):
    code = ("import runpy, sys; sys.argv[1:] = ['-q', '--name']; "
            "print([each.define_macros for each in runpy.run_path('setup.py')['extensions']()])")
    assert f'"{build_check.source_hash()}"' in run([sys.executable, '-c', code], source)
