# SPDX-License-Identifier: Apache-2.0
"""2D lidar scan registration by DBSCAN clustering, and laser odometry (Liu et al. 2023)."""
from importlib import import_module
from typing import TYPE_CHECKING

from .build_check import check_build

__all__ = [
    'SE2', 'ArgumentError', 'DbscanRegError', 'EndKind', 'Features', 'Hypothesis', 'Localizer', 'Map',
    'NodeParameters', 'Odometry', 'OdometryUpdate', 'ParameterError', 'Parameters', 'Prior', 'Recording',
    'RecordingError', 'Registration', 'Scan', 'ScanError', 'ScanGeometry', 'Segments', 'Status', 'extract_features',
    'open_recording', 'read_parameters', 'register', 'write_tum',
]

if TYPE_CHECKING:
    from .core.errors import ArgumentError, DbscanRegError, ParameterError, RecordingError, ScanError
    from .core.features.extraction import extract_features
    from .core.features.records import EndKind, Features, Segments
    from .core.geometry.se2 import SE2
    from .core.odometry.records import OdometryUpdate
    from .core.parameters.tree import Parameters
    from .core.registration.records import Hypothesis, Prior, Registration, Status
    from .core.scan import Scan
    from .core.scan_geometry import ScanGeometry
    from .places.localizer import Localizer
    from .places.map import Map
    from .recordings.checks.arrays import Odometry, register
    from .recordings.opening import open_recording
    from .recordings.recording import Recording
    from .recordings.trajectories import write_tum
    from .robot.parameter_files import read_parameters
    from .robot.parameters import NodeParameters

    __version__: str
else:
    _MODULES = {
        'core.errors': ('ArgumentError', 'DbscanRegError', 'ParameterError', 'RecordingError', 'ScanError'),
        'core.features.extraction': ('extract_features',),
        'core.features.records': ('EndKind', 'Features', 'Segments'),
        'core.geometry.se2': ('SE2',),
        'core.odometry.records': ('OdometryUpdate',),
        'core.parameters.tree': ('Parameters',),
        'core.registration.records': ('Hypothesis', 'Prior', 'Registration', 'Status'),
        'core.scan': ('Scan',),
        'core.scan_geometry': ('ScanGeometry',),
        'places.localizer': ('Localizer',),
        'places.map': ('Map',),
        'recordings.checks.arrays': ('Odometry', 'register'),
        'recordings.opening': ('open_recording',),
        'recordings.recording': ('Recording',),
        'recordings.trajectories': ('write_tum',),
        'robot.parameter_files': ('read_parameters',),
        'robot.parameters': ('NodeParameters',),
    }
    _HOMES = {name: module for module, names in _MODULES.items() for name in names}

    def __getattr__(name):
        """Load the module of a public name when the name is first used: ``--help`` of a command needs no numpy."""
        if name == '__version__':
            return import_module(f'{__name__}.command_lines').version()
        if name not in _HOMES:
            raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
        check_build()
        value = globals()[name] = getattr(import_module(f'{__name__}.{_HOMES[name]}'), name)
        return value


def __dir__() -> list[str]:
    return [*__all__, '__doc__', '__version__']
