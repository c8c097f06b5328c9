"""2D lidar scan registration by DBSCAN clustering, and laser odometry (Liu et al. 2023)."""
from .core.errors import DbscanRegError, ParameterError, RecordingError, ScanError
from .core.odometry import Odometry
from .core.parameters import Parameters
from .core.records import (EndKind, Features, Hypothesis, OdometryUpdate, Prior, Registration, Segments,
                           Status)
from .core.registration import register
from .core.scan import Scan, ScanGeometry
from .core.se2 import SE2

__all__ = [
    'DbscanRegError', 'EndKind', 'Features', 'Hypothesis', 'Odometry', 'OdometryUpdate', 'ParameterError',
    'Parameters', 'Prior', 'RecordingError', 'Registration', 'SE2', 'Scan', 'ScanError', 'ScanGeometry',
    'Segments', 'Status', 'register',
]
