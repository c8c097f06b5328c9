# SPDX-License-Identifier: Apache-2.0
"""Copies of a course that differ by noise: how far a figure scatters by chance."""
import dataclasses

import numpy as np

NOISE = 0.002
"""Standard deviation added to each range [m]."""


def noised(course, seed):
    """Return the course with noise on every range that is a return, the same for the same seed."""
    rng = np.random.default_rng(seed)
    scans = []
    for scan in course.scans:
        noise = rng.normal(0.0, NOISE, scan.geometry.size)
        ranges = np.where(scan.valid, np.clip(scan.ranges + noise, scan.geometry.range_min, scan.geometry.range_max),
                          scan.ranges)
        scans.append(dataclasses.replace(scan, ranges=ranges))
    return dataclasses.replace(course, scans=scans)


def scatter(rows):
    """Means, and two standard errors of them, of the metrics that all `rows` have."""
    shared = [name for name in rows[0] if all(name in row for row in rows)]
    values = {name: np.array([row[name] for row in rows], dtype=float) for name in shared}
    spread = {name: 2.0 * float(each.std(ddof=1)) / len(rows)**0.5 if len(rows) > 1 else float('nan')
              for name, each in values.items()}
    return {name: float(each.mean()) for name, each in values.items()}, spread
