# SPDX-License-Identifier: Apache-2.0
"""Scans of the recorder's input as LaserScan fields, and its rows of results; lies beside `recorder` when that runs."""
import math
from types import SimpleNamespace

import numpy as np

LASER = 'laser'
REFUSED = 'refused'
"""Status of a scan that raises an error of the package."""
SHAPES = {'pose': (3,), 'twist': (3,), 'covariance': (3, 3), 'twist_covariance': (3, 3), 'score': (), 'overlap': ()}


def message(given, k):
    """Scan `k` with the fields of a LaserScan message."""
    begin = int(given['beams'][:k].sum()) if k else 0
    low, step, near, far, increment = given['angles'][k].tolist()
    seconds, nanoseconds = divmod(int(given['stamps'][k]), 10**9)
    ranges = given['ranges'][begin:begin + int(given['beams'][k])]
    header = SimpleNamespace(stamp=SimpleNamespace(sec=seconds, nanosec=nanoseconds), frame_id=LASER)
    return SimpleNamespace(header=header, ranges=ranges, angle_min=low, angle_increment=step,
                           angle_max=low + step * (len(ranges) - 1), range_min=near, range_max=far,
                           time_increment=increment)


def messages(given):
    """All scans, each with the fields of a LaserScan message."""
    ends = np.cumsum(given['beams'])
    for k, (end, size) in enumerate(zip(ends.tolist(), given['beams'].tolist(), strict=True)):
        one = {'beams': given['beams'][k:k + 1], 'angles': given['angles'][k:k + 1], 'stamps': given['stamps'][k:k + 1],
               'ranges': given['ranges'][end - size:end]}
        yield message(one, 0)


def append(rows, row):
    """Add a `row`, in which what is None was refused."""
    for name, values in rows.items():
        missing = REFUSED if name == 'status' else np.full(SHAPES.get(name, ()), math.nan)
        values.append(missing if row[name] is None else row[name])


def stacked(rows):
    """Return name -> array of the values of all rows."""
    return {name: np.array(values) for name, values in rows.items()}
