"""Start scan_matcher: ``ros2 launch dbscan_reg_ros scan_matcher.launch.py``."""
import os

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription


def generate_launch_description():
    defaults = os.path.join(get_package_share_directory('dbscan_reg_ros'), 'config', 'scan_matcher.yaml')
    return LaunchDescription([
        DeclareLaunchArgument('namespace', default_value='', description='namespace of the node and its topics'),
        DeclareLaunchArgument('params_file', default_value=defaults, description='parameter file'),
        DeclareLaunchArgument('use_sim_time', default_value='false', description='take the time from /clock'),
        Node(
            package='dbscan_reg_ros', executable='scan_matcher', name='scan_matcher', output='screen',
            namespace=LaunchConfiguration('namespace'),
            parameters=[
                LaunchConfiguration('params_file'),
                {'use_sim_time': ParameterValue(LaunchConfiguration('use_sim_time'), value_type=bool)},
            ],
        ),
    ])
