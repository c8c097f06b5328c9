# SPDX-License-Identifier: Apache-2.0
"""Checks of the ranges of scans, of their limits and of their unit."""
import math

import numpy as np

from ...core.no_return import NoReturn
from .scan_warnings import Kind, LastingWarnings

TOO_LARGE = 100.0
"""Median range above which ranges are taken as millimetres or centimetres: in metres no scan exceeds it."""
BEYOND = 1.05
"""Ratio of the median range to `range_max` above which the difference is no rounding error."""
NEAREST = 0.05
"""Ranges below this [m] are codes: drivers state with them why a return is missing."""
SAME = 0.999
"""Ranges above this fraction of the greatest range are regarded as equal; several such ranges mean missing returns."""
SAMPLE, FEWEST = 256, 8
"""Approximate number of beams whose ranges are checked, and the minimum number of their returns for a warning."""
EVERY = 10
"""Units and limits are checked in this many scans at the start, then in every scan whose number is a multiple of it."""
UNITS = {1000: (Kind.MILLIMETRES, 'millimetres'), 100: (Kind.CENTIMETRES, 'centimetres')}
"""Number in a metre -> unit that ranges are sent in by mistake."""
ROOM = 0.5
"""The median range in the right unit is at least this [m]."""
STATED = 2.0, 500.0
"""The `range_max` that a driver states is between these [m]."""
STATED_MIN = 1.0
"""The `range_min` that a driver states is at most this [m]."""


class RangeChecks:
    """Check the ranges of scans one by one."""

    def __init__(self):
        self._seen = 0
        self._warnings = LastingWarnings()
        self._no_return = NoReturn()
        self._found = []

    def look(self, fields) -> list:
        """Return the warnings about the ranges of a scan, its `ScanFields`."""
        if self._seen < EVERY or self._seen % EVERY == 0:
            self._found = list(filter(None, [self._judge(fields)]))
        self._seen += 1
        return [*self._found, *self._codes(fields)]

    def _codes(self, fields):
        self._no_return.add(fields.ranges, fields.range_max, fields.angle_increment)
        value = self._no_return.known
        if value is None:
            return []
        return [self._warnings.of(Kind.NO_RETURN, value, lambda: (
            f'many beams have exactly the same largest range, {value:.6g} m, scan after scan: it is used as no return; '
            'expected inf for a beam without a return (REP-117): mend the driver, or leave it as it is'))]

    def _judge(self, fields):
        with np.errstate(invalid='ignore'):
            values = np.asarray(fields.ranges[::max(len(fields.ranges) // SAMPLE, 1)], dtype=float)
        values = np.sort(values[(values > NEAREST) & (values < math.inf)])
        missing = len(values) - np.searchsorted(values, SAME * values[-1]) if len(values) else 0
        if missing > 1:
            values = values[:-missing]
        if len(values) < FEWEST:
            return None
        median, low, high = float(values[len(values) // 2]), fields.range_min, fields.range_max
        limits, is_beyond = f'range_min is {low:.6g} m, range_max {high:.6g} m', 0.0 < BEYOND * high < median
        units = _units(values, low, high)
        if median > TOO_LARGE or (is_beyond and units == [100]):
            units = units or [1000]
            kind, names = UNITS[units[0]][0], ' or '.join(UNITS[unit][1] for unit in units)
            return self._warnings.of(kind, (low, high), lambda: (
                f'the ranges look like {names}: half of them are above {median:.6g}, {limits}; expected metres, all '
                f'three: have the driver divide by {" or ".join(map(str, units))}'))
        if low >= high > 0.0:
            kind = Kind.RANGE_MAX if is_beyond and median >= low else Kind.RANGE_MIN
            return self._warnings.of(kind, (low, high), lambda: (
                f'range_min is not below range_max: {limits}, and half of the ranges are above {median:.6g} m; '
                'expected most of them between; every return counts as missing now: mend the limits in the driver'))
        if is_beyond:
            return self._warnings.of(Kind.RANGE_MAX, high, lambda: (
                f'the ranges lie beyond range_max: half of them are above {median:.6g} m, {limits}; expected most of '
                'them between; ranges beyond range_max count as missing returns: mend range_max in the driver'))
        if median < low:
            return self._warnings.of(Kind.RANGE_MIN, low, lambda: (
                f'the ranges lie below range_min: half of them are below {median:.6g} m, {limits}; expected most of '
                'them between; ranges below range_min count as missing returns: mend range_min in the driver'))
        return None


def _units(values, low, high):
    """Return the `UNITS` in which sorted ranges ``(N,)`` that are no metres can be, by the limits that are stated."""
    near, median, far = values[[len(values) // 20, len(values) // 2, len(values) * 19 // 20]]
    found = []
    for unit in UNITS:
        fits = median >= ROOM * unit
        if 0.0 < high <= STATED[1]:
            fits &= far <= unit * high and near >= unit * low
        elif math.isfinite(high) and high > 0.0:
            fits &= STATED[0] * unit <= high <= STATED[1] * unit and low <= STATED_MIN * unit
        if fits:
            found.append(unit)
    return found
