# SPDX-License-Identifier: Apache-2.0
"""Build tf2_msgs into the virtual environment that runs this file.

The ROS 2 wheels hold no tf2_msgs, but every header and generator that is needed to make it. Where that fails, the
exit status is 1 and one line on standard output says why.
"""
import os
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

import numpy

HERE = Path(__file__).resolve().parent
PREFIX = Path(sys.prefix)
FOREIGN_PYTHON = re.compile(r'/opt/python/cp3\d+-cp3\d+/include/python3\.\d+')
FOREIGN_NUMPY = re.compile(r'/opt/python/cp3\d+-cp3\d+/lib/python3\.\d+/site-packages/numpy/_core/include')


def correct_paths():
    """Replace the paths of the machine that built the wheels by those of this one."""
    for path in (PREFIX / 'share').rglob('*.cmake'):
        text = path.read_text()
        corrected = FOREIGN_NUMPY.sub(numpy.get_include(), text)
        corrected = FOREIGN_PYTHON.sub(sysconfig.get_paths()['include'], corrected)
        if corrected != text:
            path.write_text(corrected)


def missing():
    """Return what this machine lacks, or None."""
    include = Path(sysconfig.get_paths()['include'])
    if not shutil.which(os.environ.get('CC', 'cc')) or not shutil.which(os.environ.get('CXX', 'c++')):
        return 'no C++ compiler here (Debian and Ubuntu: apt-get install g++)'
    if not (include / 'Python.h').exists():
        return f'no Python.h in {include} (Debian and Ubuntu: apt-get install python3-dev)'


def build(folder, log):
    """Configure, build and install by way of `folder`; `subprocess.CalledProcessError` when a step fails.

    The generators put the paths they are given into source text, where one with an apostrophe is no path any more: they
    are given links.
    """
    prefix, source = folder / 'prefix', folder / 'source'
    prefix.symlink_to(PREFIX)
    source.symlink_to(HERE)
    environment = os.environ | {'AMENT_PREFIX_PATH': str(prefix), 'CMAKE_PREFIX_PATH': str(prefix),
                                'PATH': f'{prefix / "bin"}{os.pathsep}{os.environ["PATH"]}'}
    python = prefix / Path(sys.executable).relative_to(PREFIX)
    for step in (['-S', source, '-B', folder / 'build', f'-DCMAKE_INSTALL_PREFIX={prefix}', '-DBUILD_TESTING=OFF',
                  f'-DPython3_EXECUTABLE={python}'],
                 ['--build', folder / 'build', '--parallel', '2', '--target', 'install']):
        subprocess.run([prefix / 'bin' / 'cmake', *step], env=environment, stdout=log, stderr=log, check=True)
    for path in (*(PREFIX / 'share' / 'tf2_msgs').rglob('*.cmake'), *(PREFIX / 'share' / 'tf2_msgs').rglob('*.*sh')):
        path.write_text(path.read_text().replace(str(prefix), str(PREFIX)))


def main():
    """Build and install the package; return the exit status."""
    reason = missing()
    if reason:
        print(reason)
        return 1
    print('Building tf2_msgs ...', file=sys.stderr)
    correct_paths()
    path = PREFIX / 'tf2_msgs.log'
    with tempfile.TemporaryDirectory(prefix='tf2_msgs-') as folder, open(path, 'w') as log:
        try:
            build(Path(folder), log)
        except subprocess.CalledProcessError:
            print(f'tf2_msgs could not be built, see {shlex.quote(str(path))}')
            return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
