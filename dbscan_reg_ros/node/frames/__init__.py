# SPDX-License-Identifier: Apache-2.0
"""Coordinate frames: transforms on /tf that are received and sent, and the mounting of the sensor."""
