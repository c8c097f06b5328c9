# SPDX-License-Identifier: Apache-2.0
"""``scan_matcher``: laser odometry as a ROS 2 node."""
import sys

from .lifecycle.spin import run_node


def main(argv=None) -> int:
    """Run the node until SIGINT or SIGTERM; the exit status is that of `run_node`."""
    return run_node('scan_matcher', 'Laser odometry: subscribes to scan, publishes odom, segments, /tf and more.', _make,
                    argv)


def _make(name):
    from rclpy.node import Node

    from .interfaces.live_parameters import LiveParameters
    from .node_core import ScanMatcher

    node = Node(name, automatically_declare_parameters_from_overrides=True)
    ScanMatcher(node, LiveParameters(node)).activate()
    return node


if __name__ == '__main__':
    sys.exit(main())
