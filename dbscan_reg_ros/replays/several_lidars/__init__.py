# SPDX-License-Identifier: Apache-2.0
"""Scans of several lidars of one recording: their order, and pairs of them."""
