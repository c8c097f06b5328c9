# SPDX-License-Identifier: Apache-2.0
"""Installation by colcon, bloom or pip: what is compiled and installed where; pyproject.toml describes the package."""
import hashlib
import importlib.util
import os
import shutil
import sys
import sysconfig
from glob import glob
from pathlib import Path

from setuptools import Extension, find_packages, setup
from setuptools.command.build_ext import build_ext
from setuptools.command.sdist import sdist
from setuptools.errors import CCompilerError, ExecError, PlatformError

PACKAGE = 'dbscan_reg_ros'
COMMANDS = ('calibrate', 'compare', 'convert', 'demo', 'play', 'register', 'replay', 'scan_matcher',
            'scan_matcher_lifecycle', 'simulate', 'tune', 'watch')
ENTRY_POINT = f'{PACKAGE}.__main__:entry_point'

if {'install', 'develop'} & set(sys.argv):
    # colcon and bloom: the executables of ``ros2 run`` in lib/dbscan_reg_ros, as setup.cfg says.
    SCRIPTS = [f'{name} = {ENTRY_POINT}' for name in COMMANDS]
else:
    # pip: what it installs goes into bin, where names as common as these would hide those of others.
    SCRIPTS = [f'dbscan-reg-ros = {ENTRY_POINT}']

# Colcon runs this file to learn the name of the package, and ignores the package when anything is printed meanwhile.
CORE = Path(PACKAGE, 'core')
SOURCES = sorted(path for suffix in ('pyx', 'pxd') for path in Path(PACKAGE).rglob(f'*.{suffix}'))
MODULES = [path.with_suffix('') for path in SOURCES if path.suffix == '.pyx']
SOURCE_HASH = CORE / 'sources'
CYTHON = importlib.util.find_spec('Cython') is not None
FLAGS = ['-O2', '-ftree-vectorize', '-ffp-contract=off', '-fcx-fortran-rules', '-fno-math-errno', '-fno-trapping-math',
         '-g0']
SHARED = CORE / 'shared'
"""Module with what Cython else repeats in each of the others, half of what is compiled."""


def extensions():
    """The compiled modules, from Cython, or from the C of a source distribution."""
    digest = hashlib.sha256(b''.join(path.read_bytes() for path in SOURCES)).hexdigest()[:16]
    included = [str(path) for path in SOURCES if path.suffix != '.pyx']
    return [Extension('.'.join(module.parts), [f'{module}.pyx'],
                      depends=list(map(str, SOURCES)) if module == SOURCE_HASH else included,
                      define_macros=[('DBSCAN_REG_SOURCE_HASH', f'"{digest}"')] if module == SOURCE_HASH else [],
                      extra_compile_args=FLAGS)
            for module in MODULES]


class BuildExtensions(build_ext):
    """Generates no C beside the sources, where it would be taken for theirs when they have changed."""

    def initialize_options(self):
        """Set the options: C is generated in the build folder, and all cores are used."""
        super().initialize_options()
        self.cython_c_in_temp = True
        self.parallel = True

    def finalize_options(self):
        """Add the module that the others share, which Cython 3.2 and newer make."""
        name = '.'.join(SHARED.parts)
        if hasattr(self, 'shared_utility_qualified_name'):
            self.shared_utility_qualified_name = name
            if name not in [each.name for each in self.distribution.ext_modules]:
                self.distribution.ext_modules.append(Extension(name, [f'{SHARED}.c'], extra_compile_args=FLAGS))
        super().finalize_options()

    def build_extensions(self):
        """Generate the C of one module after the other, as Cython is not made for threads; then compile all at once."""
        if CYTHON:
            from Cython.Build import cythonize
            shared = getattr(self, 'shared_utility_qualified_name', None)
            options = {'shared_utility_qualified_name': shared} if shared else {}
            made = cythonize(self.extensions, force=self.force, quiet=not self.verbose, build_dir=self.build_temp,
                             **options)
            sources = {each.name: each.sources for each in made}
            for extension in self.extensions:
                extension.sources = sources[extension.name]
            self.shared_utility_qualified_name = None
        super().build_extensions()

    def run(self):
        """Build; end with one line that says what is missing."""
        if not (CYTHON or all(module.with_suffix('.c').exists() for module in MODULES)):
            sys.exit(f'{PACKAGE}: its compiled modules need Cython 3.0.8 or newer: apt-get install cython3, or '
                     'pip install cython; installing a wheel takes neither Cython nor a compiler')
        try:
            super().run()
        except (CCompilerError, ExecError, PlatformError) as error:
            sys.exit(f'{PACKAGE}: its compiled modules could not be built: {missing() or error}')


def missing():
    """Return what a build needs and this machine has not; empty if nothing is known to be missing."""
    if shutil.which((os.environ.get('CC') or 'cc').split()[0]) is None:
        return ('there is no C compiler: apt-get install build-essential; or pip install ziglang, and set '
                'CC="python -m ziglang cc"')
    if not Path(sysconfig.get_paths()['include'], 'Python.h').exists():
        return 'the headers of Python are missing: apt-get install python3-dev'
    return ''


class SourceDistribution(sdist):
    """Carries the generated C, so that building it takes no Cython."""

    def make_release_tree(self, base_dir, files):
        """Copy `files` to `base_dir`, and add the generated C."""
        super().make_release_tree(base_dir, files)
        if CYTHON:
            from Cython.Build import cythonize
            cythonize([str(Path(base_dir, f'{module}.pyx')) for module in MODULES], quiet=True)
        for module in MODULES:
            if not CYTHON and module.with_suffix('.c').exists():
                self.copy_file(f'{module}.c', str(Path(base_dir, f'{module}.c')))


setup(
    name=PACKAGE,
    version='0.1.0',
    license='Apache-2.0',
    python_requires='>=3.10',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={PACKAGE: ['py.typed', 'replays/page/*.html', 'replays/page/*.css', 'replays/page/*.js',
                            *(str(path.relative_to(PACKAGE)) for suffix in ('pyi', 'pyx', 'pxd')
                              for path in sorted(Path(PACKAGE).rglob(f'*.{suffix}')))]},
    ext_modules=extensions(),
    cmdclass={'build_ext': BuildExtensions, 'sdist': SourceDistribution},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/config', glob('config/*')),
        (f'share/{PACKAGE}/launch', glob('launch/*.launch.py')),
    ],
    entry_points={'console_scripts': SCRIPTS},
    zip_safe=False,
)
