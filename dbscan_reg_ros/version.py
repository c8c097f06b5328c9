# SPDX-License-Identifier: Apache-2.0
"""Which version of the package this is."""
import argparse
from pathlib import Path

from .backend_choice import choose

PACKAGE = 'dbscan_reg_ros'
MANIFEST = Path(__file__).absolute().parent.parent / 'package.xml'
"""There where the package runs from its source."""


def version() -> str:
    """Return the version in the source's manifest, else that of the installed package."""
    if MANIFEST.exists():
        from xml.etree import ElementTree
        return str(ElementTree.parse(MANIFEST).getroot().findtext('version'))
    from importlib.metadata import version as installed
    return installed(PACKAGE)


class _Version(argparse.Action):
    """Looks the version up only when it is asked for."""

    def __call__(self, parser, namespace, values, option_string=None):
        print(f'{PACKAGE} {version()} ({choose().name} backend)')
        parser.exit()


def add_version(parser):
    """Add the option ``--version``."""
    parser.add_argument('--version', action=_Version, nargs=0, help='show version and backend, and exit')
