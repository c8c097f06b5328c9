# SPDX-License-Identifier: Apache-2.0
"""Tolerances that do not depend on the sensor or the building."""

TINY = 1e-9
"""Sums, lengths and ratios below this are rounding errors; divisors are at least this."""
ROUNDING = 1e-11
"""Largest relative difference of two equal sums or weights that rounding errors explain."""
RESOLUTION = 0.001
"""Length [m] and angle [rad] that no lidar resolves: the lower limit of kernel scales and standard deviations."""
SAME = 0.1
"""Distance [m] and angle [rad] below which two lines, ends of lines or motions count as the same."""
SIGMAS = 3.0
"""Number of standard deviations that noise rarely exceeds."""
