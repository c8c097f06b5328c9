# SPDX-License-Identifier: Apache-2.0
"""Registration and odometry, with numpy, scipy and scikit-learn only: no ROS, files, clock or module-level state."""
