# SPDX-License-Identifier: Apache-2.0
"""Hides packages from Python and its children while this folder is on PYTHONPATH.

``WITHOUT_PACKAGES`` names them, with a space between two; they are as if they were not installed.
"""
import os
from importlib.machinery import PathFinder

HIDDEN = frozenset(os.environ.get('WITHOUT_PACKAGES', '').split())
_find_spec = PathFinder.find_spec


@classmethod
def find_spec(_finder, fullname, path=None, target=None):
    return None if fullname.partition('.')[0] in HIDDEN else _find_spec(fullname, path, target)


PathFinder.find_spec = find_spec
