# SPDX-License-Identifier: Apache-2.0
"""The method, which uses numpy, scipy and scikit-learn only: no ROS, no files, no clock, no module-level state."""
