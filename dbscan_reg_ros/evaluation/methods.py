# SPDX-License-Identifier: Apache-2.0
"""Registration methods of this and other packages, called as ``method(reference_scan, current_scan) -> record``."""
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..core.errors import DbscanRegError, ScanError
from ..core.features.extraction import extract_features
from ..core.geometry.se2 import SE2
from ..core.paper.pipeline import ScanLines
from ..core.paper.pipeline import register as register_literally
from ..core.parameters.tree import Parameters
from ..core.registration.pipeline import register
from ..core.registration.records import Prior, Status
from ..requirements import missing_line
from .baselines import Result, icl, icp, idc

LAYERS = 0.1 * np.arange(-2, 3)
GATE, GATE_GUESSED = 2.0, 0.5
"""Largest distance of corresponding points in GICP [m], without and with a guess: the values with the best results."""
LEAST_RETURNS = 5
GUESS_COVARIANCE = np.diag((0.1, 0.1, 0.05)) ** 2


class BenchmarkError(DbscanRegError):
    """The method or measure is unknown, or needs a package that is not installed."""


@dataclass(frozen=True)
class Method:
    """A method of registration of two scans."""

    name: str
    prepare: Callable
    """``prepare(scan)`` returns what is computed only once for each scan."""
    align: Callable
    """``align(prepared_reference, prepared_current, guess=None)`` returns a record with `transform` and `status`;
    `guess` is an `SE2`."""

    def __call__(self, reference, current):
        """Register the `Scan` `current` onto the `Scan` `reference`, without a guess."""
        return self.align(self.prepare(reference), self.prepare(current))


def method(name) -> Method:
    """Return the method called `name`.

    Raises a BenchmarkError when there is no method with this name, or a package that it needs is not installed.
    """
    if name not in FACTORIES:
        raise BenchmarkError(f'unknown method {name!r}; expected one of {", ".join(FACTORIES)}')
    try:
        return FACTORIES[name](name)
    except ImportError as error:
        raise BenchmarkError(f'method {name} {missing_line([(error.name or name).partition(".")[0]])}') from error


def chosen(names=None) -> list:
    """Return the methods called `names`; without names, every method whose packages are installed."""
    if names:
        return [method(name) for name in names]
    found = []
    for name in FACTORIES:
        try:
            found.append(method(name))
        except DbscanRegError as missing:
            print(f'left out: {missing}', file=sys.stderr)
    return found


def _ours(parameters, name):
    def prepare(scan):
        try:
            features = extract_features(scan, parameters)
        except ScanError:
            return None
        # Made when first asked for; a reference was a current scan once and has them.
        for name in ('free_space', 'leverage'):
            getattr(features, name)
        return features

    def align(reference, current, guess=None):
        if reference is None or current is None:
            return Result(SE2(), Status.FAILED)
        return register(reference, current, parameters, guess and Prior(guess, GUESS_COVARIANCE))

    return Method(name, prepare, align)


def _dbscan(name):
    return _ours(Parameters(), name)


def _paper(name):
    def prepare(scan):
        try:
            return ScanLines.of(scan)
        except ScanError:
            return None

    def align(reference, current, guess=None):
        if reference is None or current is None:
            return Result(SE2(), Status.FAILED)
        return register_literally(reference, current)

    return Method(name, prepare, align)


def _baseline(module):
    def align(reference, current, guess=None):
        return module.align(reference, current, guess or SE2())

    return lambda name: Method(name, module.prepare, align)


def _identity(name):
    return Method(name, lambda scan: None, lambda reference, current, guess=None: Result(SE2(), Status.OK))


def _small_gicp(name):
    """Make the method GICP, which uses all returns, copied to several heights so that 3D normals can be computed."""
    import small_gicp

    def prepare(scan):
        # Without points it ends the process.
        if scan.valid.sum() < LEAST_RETURNS:
            return None
        return small_gicp.preprocess_points(lifted(scan, LAYERS), 0.01, 20, 1)

    def align(reference, current, guess=None):
        if reference is None or current is None:
            return Result(guess or SE2(), Status.FAILED)
        (target, tree), (source, _) = reference, current
        gate = GATE if guess is None else GATE_GUESSED
        result = small_gicp.align(target, source, tree, spatial(guess or SE2()), 'GICP', gate, 1)
        return Result(planar(result.T_target_source), Status.OK if result.converged else Status.FAILED)

    return Method(name, prepare, align)


def _kiss_icp(name):
    """Make the method KISS-ICP: it registers the current scan to a map of the reference, with the initial threshold."""
    from kiss_icp.kiss_icp import KissICP

    def prepare(scan):
        return lifted(scan, [0.0])

    def align(reference, current, guess=None):
        pipeline = KissICP(kiss_config())
        pipeline.register_frame(reference, np.empty(0))
        pipeline.last_delta = spatial(guess or SE2())
        pipeline.register_frame(current, np.empty(0))
        return Result(planar(pipeline.last_pose), Status.OK)

    return Method(name, prepare, align)


def kiss_config():
    """Return the configuration of KISS-ICP for a 2D lidar indoors: voxels of 0.2 m, one thread, no deskewing."""
    from kiss_icp.config import KISSConfig
    config = KISSConfig()
    config.data.deskew = False
    config.mapping.voxel_size = 0.2
    config.registration.max_num_threads = 1
    return config


def lifted(scan, heights):
    """Return the returns of `scan` as points in space ``(P, 3)`` [m], once at each of the `heights` [m]."""
    points = scan.points[scan.valid]
    return np.column_stack((np.tile(points, (len(heights), 1)), np.repeat(heights, len(points))))


def spatial(transform):
    """Return the ``(4, 4)`` matrix in 3D of an `SE2`."""
    matrix = np.eye(4)
    matrix[:2, :2] = transform.rotation()
    matrix[:2, 3] = transform.x, transform.y
    return matrix


def planar(matrix):
    """Return the planar part of a rigid motion in 3D, a ``(4, 4)`` matrix, as an `SE2`."""
    return SE2(float(matrix[0, 3]), float(matrix[1, 3]), math.atan2(matrix[1, 0], matrix[0, 0]))


FACTORIES = {
    'dbscan': _dbscan,
    'paper': _paper,
    'small_gicp': _small_gicp,
    'kiss-icp': _kiss_icp,
    'icp': _baseline(icp),
    'idc': _baseline(idc),
    'icl': _baseline(icl),
    'identity': _identity,
}
