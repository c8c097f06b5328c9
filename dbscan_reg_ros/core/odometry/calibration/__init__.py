# SPDX-License-Identifier: Apache-2.0
"""Calibration of several lidars against each other: relative mounting and time offset."""
