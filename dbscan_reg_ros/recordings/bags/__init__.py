# SPDX-License-Identifier: Apache-2.0
"""Reading and writing of ROS 1 and ROS 2 bags, and diagnosis of damaged bags."""
