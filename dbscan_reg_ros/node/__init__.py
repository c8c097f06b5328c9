# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 node: turns messages into scans and results into messages, and decides nothing about geometry."""
