# SPDX-License-Identifier: Apache-2.0
"""Playback of a recording to a running node, and the odometry that it publishes."""
