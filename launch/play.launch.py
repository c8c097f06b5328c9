# SPDX-License-Identifier: Apache-2.0
"""Play a recording to scan_matcher: ``ros2 launch dbscan_reg_ros play.launch.py recording:=FILE``.

The arguments of scan_matcher.launch.py count here as well. The time is that of the recording, and where it holds no static
transforms the laser is the base, unless ``sensor``, ``params_file`` or an argument says otherwise.
"""
from launch.actions import DeclareLaunchArgument, OpaqueFunction

from dbscan_reg_ros.node.launching import matcher_arguments, player_actions
from launch import LaunchDescription


def generate_launch_description():
    return LaunchDescription([
        DeclareLaunchArgument('recording', description='CARMEN log (plain or gzip), ROS 1 bag or ROS 2 bag'),
        DeclareLaunchArgument('rate', default_value='1.0', description='times the speed of the recording'),
        DeclareLaunchArgument('topics', default_value='', description='topics of the recording that are published beside '
                              'those that scan_matcher uses, with spaces between them'),
        *matcher_arguments(),
        OpaqueFunction(function=player_actions),
    ])
