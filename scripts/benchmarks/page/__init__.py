# SPDX-License-Identifier: Apache-2.0
"""Benchmark of the page of a replay in a real browser."""
