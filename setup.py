# SPDX-License-Identifier: Apache-2.0
"""Installation by colcon, bloom or pip."""
import hashlib
import importlib.util
import sys
from glob import glob
from pathlib import Path

from setuptools import Extension, find_packages, setup
from setuptools.command.build_ext import build_ext
from setuptools.command.sdist import sdist

PACKAGE = 'dbscan_reg_ros'
COMMANDS = ('calibrate', 'compare', 'convert', 'demo', 'dump', 'play', 'register', 'replay', 'scan_matcher',
            'scan_matcher_lifecycle', 'simulate', 'tune', 'watch')
ENTRY_POINT = f'{PACKAGE}.__main__:entry_point'

if {'install', 'develop'} & set(sys.argv):
    # colcon and bloom: the executables of ``ros2 run`` in lib/dbscan_reg_ros, as setup.cfg says.
    SCRIPTS = [f'{name} = {ENTRY_POINT}' for name in COMMANDS]
else:
    # pip: what it installs goes into bin, where names as common as these would hide those of others.
    SCRIPTS = [f'dbscan-reg-ros = {ENTRY_POINT}']

# Colcon runs this file to learn the name of the package, and ignores the package when anything is printed meanwhile.
STEPS = f'{PACKAGE}/core/accelerated/steps'
SOURCES = sorted(path for suffix in ('pyx', 'pxi') for path in Path(STEPS).parent.rglob(f'*.{suffix}'))
CYTHON = importlib.util.find_spec('Cython') is not None


def extensions():
    """The compiled steps, where they can be built: with Cython, or from the C of a source distribution."""
    if not (SOURCES and (CYTHON or Path(f'{STEPS}.c').exists())):
        return []
    digest = hashlib.sha256(b''.join(path.read_bytes() for path in SOURCES)).hexdigest()[:16]
    return [Extension(STEPS.replace('/', '.'), [f'{STEPS}.pyx'], depends=[str(path) for path in SOURCES], optional=True,
                      define_macros=[('DBSCAN_REG_SOURCE_HASH', f'"{digest}"')],
                      extra_compile_args=['-ffp-contract=off', '-fcx-fortran-rules', '-fno-math-errno', '-g0'])]


class BuildExtensions(build_ext):
    """Generates no C beside the sources, where it would be taken for theirs when they have changed."""

    def initialize_options(self):
        """Set the options: C is generated in the build folder."""
        super().initialize_options()
        self.cython_c_in_temp = True


class SourceDistribution(sdist):
    """Carries the generated C, so that building it takes no Cython."""

    def make_release_tree(self, base_dir, files):
        """Copy `files` to `base_dir`, and add the generated C."""
        super().make_release_tree(base_dir, files)
        if CYTHON:
            from Cython.Build import cythonize
            cythonize([str(Path(base_dir, f'{STEPS}.pyx'))], quiet=True)
        elif Path(f'{STEPS}.c').exists():
            self.copy_file(f'{STEPS}.c', str(Path(base_dir, f'{STEPS}.c')))


setup(
    name=PACKAGE,
    version='0.1.0',
    description='2D lidar odometry by registration of line segments with DBSCAN clustering',
    license='Apache-2.0',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={PACKAGE: ['py.typed', 'replays/page/*.html', 'replays/page/*.css', 'replays/page/*.js',
                            'core/accelerated/*.pyi', 'core/accelerated/*.pyx',
                            'core/accelerated/*.pxi', 'core/accelerated/*/*.pxi']},
    ext_modules=extensions(),
    cmdclass={'build_ext': BuildExtensions, 'sdist': SourceDistribution},
    python_requires='>=3.10',
    install_requires=['numpy>=1.26', 'scipy>=1.11.4', 'scikit-learn>=1.4.1', 'PyYAML'],
    extras_require={'commands': ['matplotlib', 'pillow', 'rosbags', 'tqdm'], 'cluster': ['distributed'],
                    'tune': ['optuna'], 'test': ['hypothesis', 'pytest']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/config', glob('config/*')),
        (f'share/{PACKAGE}/launch', glob('launch/*.launch.py')),
    ],
    entry_points={'console_scripts': SCRIPTS},
    zip_safe=False,
)
