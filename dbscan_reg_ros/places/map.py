# SPDX-License-Identifier: Apache-2.0
"""Maps of key frames, and their files.

The file is an ``.npz`` archive of plain numpy arrays, read without pickle:

``map``
    uint8, the bytes of a JSON text (UTF-8)::

        {"format": "dbscan_reg_ros map", "version": 1, "package": "0.1.0", "mounting": [x, y, yaw],
         "scans": [{"stamp": ns, "frame_id": "laser", "time_increment": s, "angle_min": rad, "angle_increment": rad,
                    "range_min": m, "range_max": m or null}, ...]}

    ``scans`` are those of the views, as `Odometry` received them; ``mounting`` is the pose of their frame on the robot.
``ranges_I``, ``bearings_I``
    Ranges of scan I, and its bearings if they are not uniform, as in `recordings.archives.scan_fields`.
``poses``
    float64 (K, 3), pose of each key frame in the map.
``pairs``, ``motions``, ``covariances``
    int64 (E, 2), float64 (E, 3) and (E, 3, 3), as in `Constraints`.
``frames``
    int64 (V,), number of the key frame of each view.
``twists``
    float64 (V, 3) [m/s, m/s, rad/s], velocity with which each view is deskewed; NaN: it is not.
``noise_ratios``
    float64 (V,), standard deviation of a range as a fraction of the range.
"""
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.errors import DbscanRegError
from ..core.features.extraction import extract_from_returns
from ..core.features.records import Features
from ..core.features.returns import Returns
from ..core.geometry.se2 import SE2, wrap
from ..core.parameters.tree import Parameters
from ..core.scan import Scan
from ..recordings.archives import Archive, scan_fields, scans_of
from ..recordings.trajectories import finite_numbers
from .pose_graph import Constraints, PoseGraph

SPACING = 0.7
"""A key frame keeps its scan as a view unless the scan of another one within this distance [m] shows the same part."""
COMMON = 0.75
"""Two scans at one place show the same part if they have at least this fraction of their field of view in common."""


class MapError(DbscanRegError, ValueError):
    """A map cannot be read or used."""


ARCHIVE = Archive('map', 'dbscan_reg_ros map', 1, 'replay --map-out', MapError)


class View(NamedTuple):
    """What was seen from a key frame.

    Attributes
    ----------
    frame : int
        Number of the key frame.
    scan : Scan
        The scan as the odometry received it.
    twist : (3,) float or None
        Velocity [m/s, m/s, rad/s] with which it is deskewed; None: it is not.
    noise_ratio : float
        Standard deviation of a range as a fraction of the range.
    """

    frame: int
    scan: Scan
    twist: NDArray[np.float64] | None
    noise_ratio: float

    def features(self, parameters: Parameters) -> Features:
        """Extract the features of the scan."""
        return extract_from_returns(Returns(self.scan, parameters.scan, self.twist), parameters, self.noise_ratio,
                                    parameters.odometry.pole_size)


def difference(poses: NDArray[np.float64], pose: NDArray[np.float64], scan: Scan) -> NDArray[np.float64]:
    """Return how much scans like `scan` from the `poses` (N, 3) differ from one from `pose` (3,); up to 1: hardly."""
    apart = np.hypot(*(poses - pose)[:, :2].T) / SPACING
    if scan.geometry.closed:
        return apart
    part = abs(scan.geometry.angle_increment) * scan.geometry.size
    return np.maximum(apart, np.abs(wrap(poses[:, 2] - pose[2])) / ((1.0 - COMMON) * part))


@dataclass(frozen=True, eq=False)
class Map:
    """A map of key frames: their poses, the motions between them, and what was seen from some of them.

    Attributes
    ----------
    graph : PoseGraph
        Poses of the key frames in the map: of the first lidar, turned so that its axes are those of the robot.
    views : list of View
    mounting : SE2
        Pose of the frame of the scans on the robot.
    """

    graph: PoseGraph
    views: list[View]
    mounting: SE2 = field(default_factory=SE2)

    @classmethod
    def load(cls, path) -> 'Map':
        """Read the map in the file at `path`; raise a MapError if the file cannot be read or is no map."""
        return ARCHIVE.read(path, _map)

    def save(self, path) -> None:
        """Write the map to the file at `path`; the file appears complete or not at all."""
        poses, constraints = self.graph
        arrays = {'poses': poses, **constraints._asdict(),
                  'frames': np.array([view.frame for view in self.views], dtype=np.int64),
                  'twists': np.array([np.full(3, np.nan) if view.twist is None else view.twist for view in self.views]),
                  'noise_ratios': np.array([view.noise_ratio for view in self.views])}
        scans = scan_fields([view.scan for view in self.views], arrays)
        ARCHIVE.write(path, {'mounting': self.mounting.as_tuple(), 'scans': scans}, arrays)

    @property
    def poses(self) -> NDArray[np.float64]:
        """``(V, 3)`` poses of the views in the map [m, m, rad]."""
        return self.graph.poses[[view.frame for view in self.views]]


def _map(fields, arrays) -> Map:
    """Return the map of the JSON `fields` and the `arrays` of an archive, once all of them fit together."""
    scans, frames = scans_of(fields['scans'], arrays), arrays['frames']
    constraints = Constraints(arrays['pairs'], arrays['motions'], arrays['covariances'])
    count, edges, shapes = len(arrays['poses']), len(constraints.pairs), {
        'poses': (-1, 3), 'pairs': (-1, 2), 'motions': (-1, 3), 'covariances': (-1, 3, 3), 'frames': (len(scans),),
        'twists': (len(scans), 3), 'noise_ratios': (len(scans),)}
    for name, shape in shapes.items():
        array = arrays[name]
        if array.shape[1:] != shape[1:] or shape[0] not in (-1, len(array)) or array.dtype.kind not in 'if':
            raise ValueError(f'{name} has the shape {array.shape} of {array.dtype}')
    numbers = np.concatenate((frames.ravel(), constraints.pairs.ravel(), [0]))
    if len({edges, *map(len, constraints)}) > 1 or not (numbers.min() >= 0 and numbers.max() < count):
        raise ValueError(f'{edges} constraints and {len(frames)} views do not belong to {count} key frames')
    for name in ('poses', 'motions', 'covariances', 'noise_ratios'):
        if not np.isfinite(arrays[name]).all():
            raise ValueError(f'{name} are not finite')
    np.linalg.cholesky(constraints.covariances)
    views = [View(int(frame), scan, None if np.isnan(twist).any() else twist, float(ratio))
             for frame, scan, twist, ratio in zip(frames, scans, arrays['twists'], arrays['noise_ratios'], strict=True)]
    return Map(PoseGraph(arrays['poses'], constraints), views, SE2.from_array(finite_numbers(fields['mounting'])))
