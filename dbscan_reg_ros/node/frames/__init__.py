# SPDX-License-Identifier: Apache-2.0
"""Coordinate frames: transforms received and sent, and where the sensor is mounted."""
