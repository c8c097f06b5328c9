# SPDX-License-Identifier: Apache-2.0
"""Comparison of two commits, bit for bit."""
