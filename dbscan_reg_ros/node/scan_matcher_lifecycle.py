# SPDX-License-Identifier: Apache-2.0
"""``scan_matcher_lifecycle``: laser odometry as a ROS 2 lifecycle node."""
from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from .lifecycle.spin import run_node

if TYPE_CHECKING:
    from rclpy.node import Node


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; return the exit status of `run_node`."""
    description = ('Laser odometry as scan_matcher, as a lifecycle node: configure creates its publishers, activate '
                   'subscribes to the scans.')
    return run_node('scan_matcher_lifecycle', description, _make, argv)


def _make(_name: str) -> Node:
    from .lifecycle.lifecycle_node import ScanMatcherLifecycleNode
    return ScanMatcherLifecycleNode()


if __name__ == '__main__':
    sys.exit(main())
