# SPDX-License-Identifier: Apache-2.0
"""Robot side of the odometry, without ROS: sensor mounting, history of poses, state of the base, parameter files."""
