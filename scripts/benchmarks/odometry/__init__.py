# SPDX-License-Identifier: Apache-2.0
"""Odometry of recordings and simulated courses."""
