# SPDX-License-Identifier: Apache-2.0
"""2D lidar scan registration by DBSCAN clustering, and laser odometry (Liu et al. 2023)."""
from importlib import import_module

_HOME = {
    'DbscanRegError': 'errors', 'ParameterError': 'errors', 'RecordingError': 'errors', 'ScanError': 'errors',
    'Odometry': 'odometry.pipeline', 'Parameters': 'parameters.tree',
    'EndKind': 'features.records', 'Features': 'features.records', 'Hypothesis': 'registration.records', 'OdometryUpdate': 'odometry.records',
    'Prior': 'registration.records', 'Registration': 'registration.records', 'Segments': 'features.records', 'Status': 'registration.records',
    'register': 'registration.pipeline', 'Scan': 'scan', 'ScanGeometry': 'scan', 'SE2': 'geometry.se2',
}
__all__ = list(_HOME)


def __getattr__(name):
    """Names are fetched when they are first used: a command's ``--help`` needs no numpy."""
    if name not in _HOME:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'{__name__}.core.{_HOME[name]}'), name)


def __dir__():
    return sorted({*globals(), *__all__})
