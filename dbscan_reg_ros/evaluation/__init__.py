# SPDX-License-Identifier: Apache-2.0
"""Measures of trajectories, other methods, and comparisons."""
