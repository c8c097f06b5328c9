# SPDX-License-Identifier: Apache-2.0
"""Scans of several lidars of one recording: their order, their odometry, and pairs of them."""
