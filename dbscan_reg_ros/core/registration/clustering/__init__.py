# SPDX-License-Identifier: Apache-2.0
"""Hypotheses by clustering with DBSCAN: rotations (Eq. 9), and translations (Eq. 10-15)."""
