# SPDX-License-Identifier: Apache-2.0
"""Start scan_matcher: ``ros2 launch dbscan_reg_ros scan_matcher.launch.py``; ``--show-args`` lists what may be told.

What is told counts in this order, the last the most: the defaults of the node, ``sensor``, ``params_file``, the other
arguments that are given.
"""
from launch.actions import OpaqueFunction

from dbscan_reg_ros.node.launching import matcher_arguments, scan_matcher_actions
from launch import LaunchDescription


def generate_launch_description():
    return LaunchDescription([*matcher_arguments(), OpaqueFunction(function=scan_matcher_actions)])
