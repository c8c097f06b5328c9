# SPDX-License-Identifier: Apache-2.0
"""Geometry of the plane: rigid motions, symmetric matrices, line fits, robust kernel."""
