"""Play a recording to scan_matcher: ``ros2 launch dbscan_reg_ros play.launch.py recording:=FILE``."""
import os

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription


def generate_launch_description():
    defaults = os.path.join(get_package_share_directory('dbscan_reg_ros'), 'config', 'scan_matcher.yaml')
    player = Node(
        package='dbscan_reg_ros', executable='play', name='play', output='screen',
        namespace=LaunchConfiguration('namespace'),
        arguments=[LaunchConfiguration('recording'), '--clock', '--rate', LaunchConfiguration('rate')])
    return LaunchDescription([
        DeclareLaunchArgument('recording', description='CARMEN log (plain or gzip), ROS 1 bag or ROS 2 bag'),
        DeclareLaunchArgument('rate', default_value='1.0', description='times the speed of the recording'),
        DeclareLaunchArgument('namespace', default_value='', description='namespace of the nodes and their topics'),
        DeclareLaunchArgument('params_file', default_value=defaults, description='parameter file'),
        DeclareLaunchArgument('mounting', default_value='none',
                              description='where the laser sits on the base: none, for only scans are played, or laser_pose'),
        Node(
            package='dbscan_reg_ros', executable='scan_matcher', name='scan_matcher', output='screen',
            namespace=LaunchConfiguration('namespace'),
            parameters=[
                LaunchConfiguration('params_file'),
                {'use_sim_time': True, 'mounting': LaunchConfiguration('mounting')},
            ]),
        player,
        RegisterEventHandler(OnProcessExit(target_action=player, on_exit=[EmitEvent(event=Shutdown())])),
    ])
