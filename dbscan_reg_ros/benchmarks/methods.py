"""Ours, its rivals and the floor, all as ``method(reference_scan, current_scan) -> record``."""
import importlib.metadata
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..baselines import Result, icl, icp, idc
from ..core.errors import DbscanRegError, ScanError
from ..core.features import extract_features
from ..core.parameters import Parameters
from ..core.records import Status
from ..core.registration import register
from ..core.se2 import SE2

LAYERS = 0.1 * np.arange(-2, 3)
GATE = 2.0


class MethodMissing(DbscanRegError):
    """A method is unknown, or what it needs is not installed."""


@dataclass(frozen=True)
class Method:
    """One way to register two scans.

    Attributes
    ----------
    prepare : callable
        ``prepare(scan)``: what is computed once a scan.
    align : callable
        ``align(prepared_reference, prepared_current)``: a record with `transform` and `status`.
    version : str
    """

    name: str
    prepare: Callable
    align: Callable
    version: str = ''

    def __call__(self, reference, current):
        """Register the `Scan` `current` onto the `Scan` `reference`, without a guess."""
        return self.align(self.prepare(reference), self.prepare(current))


def method(name) -> Method:
    """The method called `name`.

    Raises
    ------
    MethodMissing
        When there is no such method, or a package that it needs is not installed.
    """
    if name not in FACTORIES:
        raise MethodMissing(f'unknown method {name!r}; expected one of {", ".join(FACTORIES)}')
    try:
        return FACTORIES[name](name)
    except ImportError as error:
        raise MethodMissing(f'method {name} needs a package that is not installed ({error}): '
                            f'pip install {error.name or name}') from error


def chosen(names=None) -> list:
    """The methods called `names`; without names every one that can run here."""
    if names:
        return [method(name) for name in names]
    found = []
    for name in FACTORIES:
        try:
            found.append(method(name))
        except MethodMissing as missing:
            print(f'left out: {missing}', file=sys.stderr)
    return found


def _ours(parameters, name):
    def prepare(scan):
        try:
            return extract_features(scan, parameters)
        except ScanError:
            return None

    def align(reference, current):
        if reference is None or current is None:
            return Result(SE2(), Status.FAILED)
        return register(reference, current, parameters)

    return Method(name, prepare, align)


def _dbscan(name):
    return _ours(Parameters(), name)


def _paper(name):
    from ..parameter_files import read_parameters
    path = Path(__file__).resolve().parents[2] / 'config' / 'paper.yaml'
    return _ours(read_parameters(path), name)


def _identity(name):
    return Method(name, lambda scan: None, lambda reference, current: Result(SE2(), Status.OK))


def _small_gicp(name):
    """GICP on every return; layers above each other give the points of a plane their normals."""
    import small_gicp

    def prepare(scan):
        return small_gicp.preprocess_points(_lifted(scan, LAYERS), 0.01, 20, 1)

    def align(reference, current):
        (target, tree), (source, _) = reference, current
        result = small_gicp.align(target, source, tree, np.eye(4), 'GICP', GATE, 1)
        return Result(_planar(result.T_target_source), Status.OK if result.converged else Status.FAILED)

    return Method(name, prepare, align, importlib.metadata.version('small_gicp'))


def _kiss_icp(name):
    """The reference fills the map, the current scan is registered to it with the first threshold."""
    from kiss_icp.kiss_icp import KissICP

    def prepare(scan):
        return _lifted(scan, [0.0])

    def align(reference, current):
        pipeline = KissICP(kiss_config())
        for points in (reference, current):
            pipeline.register_frame(points, np.empty(0))
        return Result(_planar(pipeline.last_pose), Status.OK)

    return Method(name, prepare, align, importlib.metadata.version('kiss-icp'))


def kiss_config():
    """KISS-ICP for a 2D lidar indoors: voxels of 0.2 m, one thread, no deskewing."""
    from kiss_icp.config import KISSConfig
    config = KISSConfig()
    config.data.deskew = False
    config.mapping.voxel_size = 0.2
    config.adaptive_threshold.initial_threshold = GATE
    config.registration.max_num_threads = 1
    return config


def _lifted(scan, heights):
    points = scan.points[scan.valid]
    return np.column_stack((np.tile(points, (len(heights), 1)), np.repeat(heights, len(points))))


def _planar(matrix):
    return SE2(float(matrix[0, 3]), float(matrix[1, 3]), math.atan2(matrix[1, 0], matrix[0, 0]))


FACTORIES = {
    'dbscan': _dbscan,
    'paper': _paper,
    'small_gicp': _small_gicp,
    'kiss-icp': _kiss_icp,
    'icp': lambda name: Method(name, icp.prepare, icp.align),
    'idc': lambda name: Method(name, idc.prepare, idc.align),
    'icl': lambda name: Method(name, icl.prepare, icl.align),
    'identity': _identity,
}
