# SPDX-License-Identifier: Apache-2.0
"""``scan_matcher``: laser odometry as a ROS 2 node."""
from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from .lifecycle.spin import run_node

if TYPE_CHECKING:
    from rclpy.node import Node


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; return the exit status of `run_node`."""
    description = 'Laser odometry: subscribes to scan, publishes odom, segments, /tf and more.'
    return run_node('scan_matcher', description, _make, argv)


def _make(name: str) -> Node:
    from rclpy.node import Node

    from .interfaces.live_parameters import LiveParameters
    from .node_core import NodeCore

    node = Node(name, automatically_declare_parameters_from_overrides=True)
    NodeCore(node, LiveParameters(node)).activate()
    return node


if __name__ == '__main__':
    sys.exit(main())
