"""Build tf2_msgs into the virtual environment that runs this file.

The ROS 2 wheels hold no tf2_msgs, but every header and generator that is needed to make it. Exit status: 0 built,
1 the build failed, 2 no C++ compiler.
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


def build(folder):
    cmake = PREFIX / 'bin' / 'cmake'
    environment = os.environ | {'AMENT_PREFIX_PATH': str(PREFIX), 'CMAKE_PREFIX_PATH': str(PREFIX),
                                'PATH': f'{PREFIX / "bin"}{os.pathsep}{os.environ["PATH"]}'}
    subprocess.run([cmake, '-S', HERE, '-B', folder, f'-DCMAKE_INSTALL_PREFIX={PREFIX}', '-DBUILD_TESTING=OFF',
                    f'-DPython3_EXECUTABLE={sys.executable}'], env=environment, check=True)
    subprocess.run([cmake, '--build', folder, '--parallel', '--target', 'install'], env=environment, check=True)


def main():
    if not any(shutil.which(compiler) for compiler in (os.environ.get('CXX', 'c++'), 'g++', 'clang++')):
        return 2
    correct_paths()
    with tempfile.TemporaryDirectory(prefix='tf2_msgs-') as folder:
        try:
            build(folder)
        except subprocess.CalledProcessError:
            return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
