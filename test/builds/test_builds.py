# SPDX-License-Identifier: Apache-2.0
"""The compiled steps: built where a compiler is, left out where none is."""
import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
from pathlib import Path

import pytest

from dbscan_reg_ros import backend_choice

PACKAGE = 'dbscan_reg_ros'
NO_COMPILER = {'CC': 'false', 'CXX': 'false'}
NO_CYTHON = {'WITHOUT_PACKAGES': 'Cython'}


@pytest.fixture(scope='module')
def cython(root):
    """A folder to import Cython from, where there is a compiler as well."""
    tools = root / 'build' / 'tools'
    if shutil.which('cc') is None or not Path(sysconfig.get_paths()['include'], 'Python.h').exists():
        pytest.skip('needs a C compiler and the headers of Python')
    if importlib.util.find_spec('setuptools') is None:
        pytest.skip('needs setuptools')
    if not (tools / 'Cython').exists() and importlib.util.find_spec('Cython') is None:
        pytest.skip('needs Cython, which scripts/test installs in build/tools')
    return tools


@pytest.fixture(scope='module')
def run(root, cython):
    """``run(words, folder, **environment)``: what a command prints; Cython can be imported, or not."""
    def run(words, folder, **environment):
        path = [str(root / 'test' / 'without'), str(cython), environment.pop('PYTHONPATH', '')]
        environment = os.environ | {'PYTHONPATH': os.pathsep.join(path), 'CFLAGS': '-O0'} | environment
        result = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, timeout=300,
                                check=False)
        assert result.returncode == 0, result.stdout + result.stderr
        return result.stdout
    return run


@pytest.fixture(scope='module')
def source(root, tmp_path_factory):
    """``source()``: a new copy of the tree, without anything built."""
    def source():
        folder = tmp_path_factory.mktemp('source') / PACKAGE
        shutil.copytree(root, folder, ignore=shutil.ignore_patterns('.*', '__pycache__', 'build', 'results',
                                                                    '*.egg-info', '*.so'))
        return folder
    return source


@pytest.fixture(scope='module')
def installed_backend(run, tmp_path_factory):
    """``installed_backend(folder, **environment)``: install a source tree with pip.

    The name of the backend that runs.
    """
    if not (importlib.util.find_spec('wheel') or importlib.util.find_spec('setuptools.command.bdist_wheel')):
        pytest.skip('needs setuptools 70.1, or the package wheel')

    def installed_backend(folder, **environment):
        target = tmp_path_factory.mktemp('target')
        run([sys.executable, '-m', 'pip', 'install', '-q', '--no-index', '--no-deps', '--no-build-isolation',
             '--target', target, '.'],
            folder, **environment)
        code = ('import numpy as np, dbscan_reg_ros as package; from dbscan_reg_ros.backend_choice import choose\n'
                'angles = np.linspace(-3.0, 3.0, 300); scan = package.Scan.from_ranges(2.0 + np.abs(np.sin(angles)), '
                'angles)\n'
                'print(package.__file__, choose().name, package.register(scan, scan).status.name)')
        file, name, status = run([sys.executable, '-c', code], target, PYTHONPATH=str(target)).split()
        assert file.startswith(str(target)) and status != 'FAILED'
        return name
    return installed_backend


def test_pip_builds_the_steps_where_a_compiler_and_cython_are(source, installed_backend):
    """Where the compiler is gone, what Cython has generated is of no use."""
    folder = source()
    assert installed_backend(folder) == 'compiled'
    for path in (*folder.rglob('*.o'), *folder.rglob('*.so')):
        path.unlink()
    assert [*folder.glob('build/**/steps.c')]
    assert installed_backend(folder, **NO_COMPILER) == 'reference'


def test_pip_installs_the_reference_where_cython_is_missing(source, installed_backend):
    assert installed_backend(source(), **NO_CYTHON) == 'reference'


def test_a_source_distribution_is_built_without_cython(source, run, installed_backend, tmp_path):
    run([sys.executable, 'setup.py', '-q', 'sdist', '-d', tmp_path], source())
    archive, = tmp_path.glob('*.tar.gz')
    with tarfile.open(archive) as file:
        file.extractall(tmp_path)
    folder = next(path.parent for path in tmp_path.glob('*/setup.py'))
    assert (folder / PACKAGE / 'core' / 'accelerated' / 'steps.c').exists()
    assert installed_backend(folder, **NO_CYTHON) == 'compiled'


def test_setup_prints_nothing_of_its_own(source, run):
    """Colcon runs it to learn the name, and ignores the package otherwise."""
    assert run([sys.executable, 'setup.py', '--name'], source()) == f'{PACKAGE}\n'


def test_setup_and_package_agree_on_the_hash_of_the_sources(root, source, run):
    code = ("import runpy, sys; sys.argv[1:] = ['-q', '--name']; "
            "print(runpy.run_path('setup.py')['extensions']()[0].define_macros)")
    assert f'"{backend_choice.source_hash()}"' in run([sys.executable, '-c', code], source())
