# SPDX-License-Identifier: Apache-2.0
"""``scan_matcher_lifecycle``: the same as a managed node, for bring-up managers."""
import sys

from .lifecycle.spin import run_node


def main(argv=None) -> int:
    """Run the node until SIGINT or SIGTERM; the exit status is that of `run_node`."""
    return run_node('scan_matcher_lifecycle', 'Laser odometry as scan_matcher, as a managed node: configure announces its '
                    'topics, activate begins to listen.', _make, argv)


def _make(_name):
    from .lifecycle.lifecycle_node import ManagedScanMatcher
    return ManagedScanMatcher()


if __name__ == '__main__':
    sys.exit(main())
