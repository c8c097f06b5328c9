# SPDX-License-Identifier: Apache-2.0
"""Replay of recordings, offline: the estimated trajectory, and the result files that are written."""
