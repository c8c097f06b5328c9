# SPDX-License-Identifier: Apache-2.0
"""The build of pip: that of setuptools, with a C compiler from PyPI where there is none."""
import os
import shutil
import sys

from setuptools import build_meta
from setuptools.build_meta import *  # noqa: F403

COMPILER = [] if shutil.which((os.environ.get('CC') or 'cc').split()[0]) else ['ziglang']
"""What a build requires where there is no C compiler."""
if COMPILER:
    os.environ['CC'] = f'{sys.executable} -m ziglang cc'


def get_requires_for_build_wheel(config_settings=None):
    """Return what building a wheel requires."""
    return [*build_meta.get_requires_for_build_wheel(config_settings), *COMPILER]


def get_requires_for_build_editable(config_settings=None):
    """Return what an editable installation requires."""
    return [*build_meta.get_requires_for_build_editable(config_settings), *COMPILER]
