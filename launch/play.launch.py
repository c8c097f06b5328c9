# SPDX-License-Identifier: Apache-2.0
"""Play a recording to scan_matcher: ``ros2 launch dbscan_reg_ros play.launch.py recording:=FILE``.

The arguments of scan_matcher.launch.py apply, too. Unless ``sensor``, ``params_file`` or an argument sets them,
``use_sim_time`` is true, and ``mounting`` is tf if the recording has static transforms, otherwise none.
"""
from launch.actions import DeclareLaunchArgument, OpaqueFunction

from dbscan_reg_ros.node.launching import player_actions, scan_matcher_arguments
from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Describe the launch."""
    return LaunchDescription([
        DeclareLaunchArgument('recording', description='CARMEN log (plain or gzip), ROS 1 bag or ROS 2 bag'),
        DeclareLaunchArgument('rate', default_value='1.0',
                              description='speed of the playback, relative to the recording'),
        DeclareLaunchArgument('topics', default_value='',
                              description='topics of the recording that are published besides those that scan_matcher '
                                          'uses, separated by spaces'),
        *scan_matcher_arguments(),
        OpaqueFunction(function=player_actions),
    ])
