# SPDX-License-Identifier: Apache-2.0
"""Find the robot in a map: ``ros2 launch dbscan_reg_ros localization.launch.py map:=FILE``.

Without ``map`` the map is that of the topic of this name. The arguments are those of ``scan_matcher.launch.py``.
"""
from launch.actions import OpaqueFunction

from dbscan_reg_ros.node.launching import scan_matcher_actions, scan_matcher_arguments
from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Describe the launch."""
    return LaunchDescription([*scan_matcher_arguments('localize'), OpaqueFunction(function=scan_matcher_actions)])
