# SPDX-License-Identifier: Apache-2.0
"""Parameters of a file: python 06_parameters_of_a_file.py [FILE.yaml or the name of a set, such as lds]."""
import sys

from dbscan_reg_ros import Odometry, ParameterError, read_parameters

TWO_LIDARS = """/**:
  ros__parameters:
    sensors: [front, rear]
    front: {topic: /scan_front, laser_pose: [0.3, 0.2, 0.0]}
    rear: {topic: /scan_rear, laser_pose: [-0.3, -0.2, 3.14], range_max: 20.0}
"""
if not sys.argv[1:]:
    with open('two_lidars.yaml', 'w', encoding='utf-8') as file:
        file.write(TWO_LIDARS)
try:
    parameters = read_parameters(*sys.argv[1:] or ['two_lidars.yaml'])
except ParameterError as error:
    sys.exit(f'error: {error}')
for topic in parameters.scan_topics:
    lidar = parameters.lidar(topic)
    print(f'{topic}: mounting {lidar.mounting} {lidar.laser_pose}, range_max {lidar.scan.range_max} m')
print(f'key frames: {parameters.odometry.key_frames}')
odometry = Odometry(parameters.for_odometry())  # with the parameters of the method
