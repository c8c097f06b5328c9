# SPDX-License-Identifier: Apache-2.0
"""Geometry of the plane: rigid motions, mounting of the sensor, symmetric matrices, robust kernel."""
