# SPDX-License-Identifier: Apache-2.0
"""Copies of the source tree, which go on from the build that scripts/setup made: compiling again takes minutes."""
import shutil
import sysconfig

import pytest

UNBUILT = shutil.ignore_patterns('.*', '__pycache__', 'build', 'results', '*.egg-info', '*.so')


@pytest.fixture(scope='session')
def copied(root):
    """``copied(folder, build=None)``: copy the sources to `folder`, and what is compiled, if any, to `build`."""
    def copied(folder, build=None):
        shutil.copytree(root, folder, ignore=UNBUILT)
        for part in (root / 'build').glob(f'*.{sysconfig.get_platform()}-*') if build else ():
            shutil.copytree(part, build / part.name)
        return folder
    return copied


@pytest.fixture(scope='session')
def tools(root):
    """The folder that scripts/setup installs Cython in; it is not there where Cython is installed."""
    return root / 'build' / 'tools'
