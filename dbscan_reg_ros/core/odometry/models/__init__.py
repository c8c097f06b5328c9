# SPDX-License-Identifier: Apache-2.0
"""Models of the odometry: motion, time stamps, covariance, wheel calibration and heading; one module for each."""
