# SPDX-License-Identifier: Apache-2.0
"""Registration and odometry with numpy, in `paper` also scipy and scikit-learn; no ROS, files, clock or state."""
