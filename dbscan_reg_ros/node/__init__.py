# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 node: converts messages to scans and results to messages."""
