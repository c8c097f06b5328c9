# SPDX-License-Identifier: Apache-2.0
"""Monitoring of the node and of the ROS graph: diagnostics, counters, throttled log."""
