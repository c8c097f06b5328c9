# SPDX-License-Identifier: Apache-2.0
"""Page of a running node: map, events and web server, without ROS."""
