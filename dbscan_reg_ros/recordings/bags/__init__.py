# SPDX-License-Identifier: Apache-2.0
"""ROS 1 and ROS 2 bags: reading, writing, and what may be wrong with them."""
