"""Build tf2_msgs into the virtual environment that runs this file.

The ROS 2 wheels hold no tf2_msgs, but every header and generator that is needed to make it. Where that fails, the
exit status is 1 and one line on standard output says why.
"""
import os
import pathlib
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile

import numpy

HERE = pathlib.Path(__file__).resolve().parent
PREFIX = pathlib.Path(sys.prefix)
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
    """What this machine lacks, or None."""
    include = pathlib.Path(sysconfig.get_paths()['include'])
    if not shutil.which(os.environ.get('CC', 'cc')) or not shutil.which(os.environ.get('CXX', 'c++')):
        return 'no C++ compiler here (Debian and Ubuntu: apt-get install g++)'
    if not (include / 'Python.h').exists():
        return f'no Python.h in {include} (Debian and Ubuntu: apt-get install python3-dev)'


def build(folder, log):
    """Configure, build and install; `subprocess.CalledProcessError` when a step fails."""
    cmake = PREFIX / 'bin' / 'cmake'
    environment = os.environ | {'AMENT_PREFIX_PATH': str(PREFIX), 'CMAKE_PREFIX_PATH': str(PREFIX),
                                'PATH': f'{PREFIX / "bin"}{os.pathsep}{os.environ["PATH"]}'}
    for step in (['-S', HERE, '-B', folder, f'-DCMAKE_INSTALL_PREFIX={PREFIX}', '-DBUILD_TESTING=OFF',
                  f'-DPython3_EXECUTABLE={sys.executable}'],
                 ['--build', folder, '--parallel', '2', '--target', 'install']):
        subprocess.run([cmake, *step], env=environment, stdout=log, stderr=log, check=True)


def main():
    reason = missing()
    if reason:
        print(reason)
        return 1
    print('Building tf2_msgs ...', file=sys.stderr)
    correct_paths()
    path = PREFIX / 'tf2_msgs.log'
    with tempfile.TemporaryDirectory(prefix='tf2_msgs-') as folder, open(path, 'w') as log:
        try:
            build(folder, log)
        except subprocess.CalledProcessError:
            print(f'tf2_msgs could not be built, see {path}')
            return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
