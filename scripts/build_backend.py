# SPDX-License-Identifier: Apache-2.0
"""The build of pip: that of setuptools, with a C compiler from PyPI where there is none."""
import os
import shutil
import sys

from setuptools import build_meta
from setuptools.build_meta import *  # noqa: F403


def _has_compiler():
    """Whether the compiler that the build would use is there."""
    return shutil.which((os.environ.get('CC') or 'cc').split()[0]) is not None


def get_requires_for_build_wheel(config_settings=None):
    """Return what setuptools needs, and ziglang where no compiler is found."""
    return [*build_meta.get_requires_for_build_wheel(config_settings), *([] if _has_compiler() else ['ziglang'])]


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    """Build the wheel with the compiler that is there."""
    if not _has_compiler():
        os.environ['CC'] = f'{sys.executable} -m ziglang cc'
    return build_meta.build_wheel(wheel_directory, config_settings, metadata_directory)
