# SPDX-License-Identifier: Apache-2.0
"""Version of the package."""
import argparse
from pathlib import Path

PACKAGE = 'dbscan_reg_ros'
MANIFEST = Path(__file__).absolute().parent.parent / 'package.xml'
"""Manifest with the version; it exists only if the package runs from its source tree."""


def version() -> str:
    """Return the version from the manifest in the source tree, or without one that of the installed package."""
    if MANIFEST.exists():
        from xml.etree import ElementTree
        return str(ElementTree.parse(MANIFEST).getroot().findtext('version'))
    from importlib.metadata import version as installed
    return installed(PACKAGE)


class _Version(argparse.Action):
    """Argparse action that looks up the version only if the option is given."""

    def __call__(self, parser, namespace, values, option_string=None):
        print(f'{PACKAGE} {version()}')
        parser.exit()


def add_version(parser):
    """Add the option ``--version`` to a parser."""
    parser.add_argument('--version', action=_Version, nargs=0, help='show version, and exit')
