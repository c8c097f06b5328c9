# SPDX-License-Identifier: Apache-2.0
"""Interfaces of the node to the ROS graph: scans, priors, outputs, services and parameters."""
