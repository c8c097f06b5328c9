"""Benchmarks on public recordings and on moved scans: what ``scripts/bench`` runs."""
