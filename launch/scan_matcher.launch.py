# SPDX-License-Identifier: Apache-2.0
"""Start scan_matcher: ``ros2 launch dbscan_reg_ros scan_matcher.launch.py``; ``--show-args`` lists the arguments.

A parameter has the value from the other arguments, else from ``params_file``, else from ``sensor``, else its default.
"""
from launch.actions import OpaqueFunction

from dbscan_reg_ros.node.launching import scan_matcher_actions, scan_matcher_arguments
from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Describe the launch."""
    return LaunchDescription([*scan_matcher_arguments(), OpaqueFunction(function=scan_matcher_actions)])
