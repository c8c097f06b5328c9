# SPDX-License-Identifier: Apache-2.0
"""Records the results of the package of one source tree for drives and pairs of scans: run by ``bench fingerprint``.

python recorder.py ROOT

``ROOT`` is the source tree whose package is used. Each line of standard input names an input and an output file, both
.npz, with a tab in between; one line of standard output answers each. The script runs with the package of any commit:
it imports nothing but that package's public names, and finds those that were renamed in the tables below.

An input holds the scans as plain arrays: ``stamps`` (N,) [ns], ``beams`` (N,), all ``ranges`` in a row, and ``angles``
(N, 5): angle_min, angle_increment, range_min, range_max, time_increment. ``kind`` says what is done with them:
``odometry`` (optionally with ``prior`` (N, 3) and ``prior_covariance`` (N, 3, 3)), ``register`` (with ``pairs`` (M, 2))
or ``node`` (with ``arguments`` and optionally ``places`` (N, 3), the laser on the base at each scan).
"""
import contextlib
import os
import sys
import traceback
from importlib import import_module
from pathlib import Path

import numpy as np
from node_recorder import record_node
from scan_messages import append, messages, stacked

PACKAGE = 'dbscan_reg_ros'
HOMES = {
    'Odometry': ('', 'core.odometry', 'core.odometry.pipeline'),
    'Prior': ('', 'core.records', 'core.odometry.prediction', 'core.registration'),
    'SE2': ('', 'core.se2', 'core.geometry', 'core.geometry.se2'),
    'Scan': ('', 'core.scan'),
    'extract_features': ('', 'core.features', 'core.features.extraction', 'core.features.pipeline'),
    'register': ('', 'core.registration', 'core.registration.pipeline'),
}
"""Where each name has been defined, in the order in which it is looked for; '' is the package itself."""
FIELDS = {
    'pose': ('pose',), 'covariance': ('covariance',), 'twist': ('twist',), 'twist_covariance': ('twist_covariance',),
    'status': ('status',),
}
"""Of the answer of `Odometry.process`: what is recorded, by which name."""
REGISTRATION_FIELDS = {
    'pose': ('transform', 'pose', 'motion'), 'covariance': ('covariance',), 'status': ('status',), 'score': ('score',),
    'overlap': ('overlap',),
}


def find(name):
    """Return the public object called `name` of the package, wherever this commit has it.

    AttributeError where it has none.
    """
    for home in HOMES[name]:
        with contextlib.suppress(ImportError, AttributeError):
            found = getattr(import_module(f'{PACKAGE}.{home}' if home else PACKAGE), name)
            if callable(found):
                return found
    raise AttributeError(f'{name}: not found in {PACKAGE} at {[home or PACKAGE for home in HOMES[name]]}; '
                         'add its new place to HOMES in recorder.py')


def read(record, names):
    """Return the first attribute of `record` among `names`."""
    for name in names:
        if hasattr(record, name):
            return getattr(record, name)
    raise AttributeError(f'{type(record).__name__} has none of {names}; add the new name to the tables of '
                         'recorder.py')


def as_numbers(value):
    """Return a pose, an array or a number as an array; a status as its text."""
    if hasattr(value, 'theta'):
        return np.array([value.x, value.y, value.theta])
    if hasattr(value, 'value') and isinstance(value.value, str):
        return value.value.lower()
    return np.array(value, dtype=float)


def record_odometry(given):
    """Rows of the results of `Odometry.process` for each scan."""
    odometry, scan_type, pose_type = find('Odometry')(), find('Scan'), find('SE2')
    rows = {name: [] for name in FIELDS}
    for k, each in enumerate(messages(given)):
        prior = None
        if 'prior' in given and np.isfinite(given['prior'][k]).all():
            prior = find('Prior')(pose_type(*given['prior'][k].tolist()), given['prior_covariance'][k])
        row = dict.fromkeys(FIELDS)
        try:
            update = odometry.process(scan_type.from_message(each), prior)
            row = {name: as_numbers(read(update, names)) for name, names in FIELDS.items()}
        except Exception as error:
            if not type(error).__module__.startswith(PACKAGE):
                raise
        append(rows, row)
    return stacked(rows)


def record_registrations(given):
    """Rows of the results of `register` for each pair, without a prior."""
    extract, register, scan_type = find('extract_features'), find('register'), find('Scan')
    features = [extract(scan_type.from_message(each)) for each in messages(given)]
    rows = {name: [] for name in REGISTRATION_FIELDS}
    for i, j in given['pairs'].tolist():
        result = register(features[i], features[j])
        append(rows, {name: as_numbers(read(result, names)) for name, names in REGISTRATION_FIELDS.items()})
    return stacked(rows)


def record(source, target, root):
    """Read an input, write the results of the package."""
    with np.load(source, allow_pickle=False) as file:
        given = {name: file[name] for name in file.files}
    kind = str(given['kind'])
    rows = record_node(given, root) if kind == 'node' else {
        'odometry': record_odometry, 'register': record_registrations}[kind](given)
    part = Path(f'{target}.part.npz')
    np.savez(part, **rows)
    part.replace(target)


def main():
    """Answer each line of standard input with ``done``, or with what went wrong."""
    root = os.path.realpath(sys.argv[1])
    sys.path[0] = root
    found = os.path.realpath(import_module(PACKAGE).__file__)
    if not found.startswith(root + os.sep):
        sys.exit(f'{PACKAGE} was imported from {found}, expected it in {root}')
    for line in sys.stdin:
        source, target = line.rstrip('\n').split('\t')
        try:
            record(source, target, root)
            print('done', flush=True)
        except Exception as error:  # noqa: BLE001 another commit may fail in any way, and the next drive is still recorded
            traceback.print_exc()
            print(f'{type(error).__name__}: {error}'.replace('\n', ' '), flush=True)


if __name__ == '__main__':
    main()
