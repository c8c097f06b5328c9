# SPDX-License-Identifier: Apache-2.0
"""What a robot is, without ROS: where the sensor is mounted, poses by time, parameter files."""
