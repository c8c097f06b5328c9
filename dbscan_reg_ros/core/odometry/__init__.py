# SPDX-License-Identifier: Apache-2.0
"""Laser odometry: estimates the pose of the robot from successive scans."""
