# SPDX-License-Identifier: Apache-2.0
"""Benchmarks on public recordings and on moved scans: what ``scripts/bench`` runs."""
