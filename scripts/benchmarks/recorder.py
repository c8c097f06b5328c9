# SPDX-License-Identifier: Apache-2.0
"""Records the results of the package of one source tree for drives and pairs of scans: run by ``bench fingerprint``.

python recorder.py ROOT TARGET FILE...

``ROOT`` is the source tree whose package is used. For each input file (.npz) a file of its name is written to the
folder ``TARGET``. The script runs with the package of any commit: it imports nothing but that package's public names.

An input holds the scans as plain arrays: ``stamps`` (N,) [ns], ``beams`` (N,), all ``ranges`` in a row, and ``angles``
(N, 5): angle_min, angle_increment, range_min, range_max, time_increment. The odometry processes them, optionally with
``prior`` (N, 3) and ``prior_covariance`` (N, 3, 3); with ``pairs`` (M, 2) these are registered.
"""
import math
import os
import sys
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np

PACKAGE = 'dbscan_reg_ros'
REFUSED = 'refused'
"""Status of a scan that raises an error of the package."""
ODOMETRY = {'pose': (3,), 'covariance': (3, 3), 'twist': (3,), 'twist_covariance': (3, 3), 'status': None}
REGISTRATION = {'transform': (3,), 'covariance': (3, 3), 'status': None, 'score': (), 'overlap': ()}
"""What is recorded of the answer of `Odometry.process` and of `register`, and its shape."""


def messages(given):
    """Yield all scans, each with the fields of a LaserScan message."""
    ends = np.cumsum(given['beams']).tolist()
    for end, size, stamp, angles in zip(ends, given['beams'].tolist(), given['stamps'].tolist(),
                                        given['angles'].tolist(), strict=True):
        low, step, near, far, increment = angles
        seconds, nanoseconds = divmod(stamp, 10**9)
        header = SimpleNamespace(stamp=SimpleNamespace(sec=seconds, nanosec=nanoseconds), frame_id='laser')
        yield SimpleNamespace(header=header, ranges=given['ranges'][end - size:end], angle_min=low,
                              angle_increment=step, angle_max=low + step * (size - 1), range_min=near, range_max=far,
                              time_increment=increment)


def row_of(record, shapes):
    """Return what is recorded of the answer `record`; without an answer, that the scan was refused."""
    if record is None:
        return [REFUSED if shape is None else np.full(shape, math.nan) for shape in shapes.values()]
    return [as_numbers(getattr(record, name)) for name in shapes]


def as_numbers(value):
    """Return a pose, an array or a number as an array; a status as its text."""
    if hasattr(value, 'theta'):
        return np.array([value.x, value.y, value.theta])
    return value.value if hasattr(value, 'value') else np.array(value, dtype=float)


def odometry(package, given):
    """Yield the result of `Odometry.process` for each scan; None for a scan that is refused."""
    track = package.Odometry()
    for k, each in enumerate(messages(given)):
        prior = None
        if 'prior' in given and np.isfinite(given['prior'][k]).all():
            prior = package.Prior(package.SE2(*given['prior'][k].tolist()), given['prior_covariance'][k])
        try:
            yield track.process(package.Scan.from_message(each), prior)
        except Exception as error:
            if not type(error).__module__.startswith(PACKAGE):
                raise
            yield None


def registrations(package, given):
    """Yield the result of `register` for each pair, without a prior."""
    features = [package.extract_features(package.Scan.from_message(each)) for each in messages(given)]
    return (package.register(features[i], features[j]) for i, j in given['pairs'].tolist())


def main(root, target, *files):
    """Record the results for all files."""
    sys.path[0] = os.path.realpath(root)
    package = import_module(PACKAGE)
    found = os.path.realpath(package.__file__)
    if not found.startswith(sys.path[0] + os.sep):
        sys.exit(f'{PACKAGE} was imported from {found}, expected it in {root}')
    for file in map(Path, files):
        with np.load(file, allow_pickle=False) as arrays:
            given = {name: arrays[name] for name in arrays.files}
        results, shapes = (registrations, REGISTRATION) if 'pairs' in given else (odometry, ODOMETRY)
        columns = zip(*(row_of(each, shapes) for each in results(package, given)), strict=True)
        part = Path(target, f'{file.stem}.part')
        with open(part, 'wb') as output:
            np.savez(output, **dict(zip(shapes, map(np.array, columns), strict=True)))
        part.replace(Path(target, file.name))


if __name__ == '__main__':
    main(*sys.argv[1:])
