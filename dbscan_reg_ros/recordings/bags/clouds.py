# SPDX-License-Identifier: Apache-2.0
"""Point clouds of a bag as scans, by the same conversion as in the node."""
import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from ...core.geometry.mounting import Mounting, MountingError
from ...core.geometry.se2 import SE2
from ...core.scan import Scan
from ...robot.parameter_groups import InputParameters
from ...robot.parameters import NodeParameters, mounting_from_parameters
from ...robot.point_cloud import Array, no_points, scan_from_cloud
from ..checks.scan_checks import CloudChecks
from ..playback import only
from .static_transforms import static_matrix

POINT_CLOUD = 'sensor_msgs/msg/PointCloud2'


@dataclass(frozen=True)
class CloudParameters:
    """What is needed to make scans of the point clouds of one lidar."""

    base_frame: str
    input: InputParameters
    """With the band of heights."""
    mounting: Mounting | None = None
    """Mounting of the lidar, at the height of the base; None: the transform on ``/tf_static``."""

    @classmethod
    def of(cls, parameters: NodeParameters | None = None, topic: str | None = None,
           mountings: Mapping[str, Mounting] = MappingProxyType({})) -> 'CloudParameters':
        """Return those of the lidar on a `topic`, None for the only one of the recording.

        `mountings`, topic -> `Mounting`, are those that the user gave; `parameters` by default those of a node.
        """
        parameters = parameters or NodeParameters()
        lidar = parameters.lidar(topic or '')
        given = mountings.get(topic) if topic else only(mountings.values())
        # The time offset is added to the stamps of all scans later.
        own = dataclasses.replace(lidar.input, time_offset=(0.0,))
        return cls(parameters.base_frame, own, given or mounting_from_parameters(lidar))

    def reader(self, path, topic, frame) -> 'CloudReader':
        """Return the reader of the point clouds on a `topic` of a bag, in which the lidar has this `frame`.

        Raises a MountingError when the transform from the lidar to the base is unknown.
        """
        if self.mounting:
            return CloudReader(self, self.mounting.matrix)
        matrix = static_matrix(path, topic, self.base_frame, frame)
        if matrix is None:
            raise MountingError(f'{path}: the heights of the points on {topic} are not known: no transform from '
                                f'{self.base_frame!r} to {frame!r} is on /tf_static; set base_frame, or set mounting '
                                "to 'laser_pose' (with laser_pose) or to 'none' for heights above the lidar")
        return CloudReader(self, matrix)


class CloudReader:
    """Converts the point clouds of one lidar, whose `matrix` ``(4, 4)`` transforms points [m] to the base frame.

    Attributes
    ----------
    mounting : Mounting
        Mounting of the scans, which have the axes of the base.
    problem : str
        Why the last point cloud gave no return; empty if it gave one.
    """

    def __init__(self, parameters: CloudParameters, matrix: Array) -> None:
        self.mounting = Mounting(SE2(float(matrix[0, 3]), float(matrix[1, 3])))
        self.problem = ''
        self._parameters, self._matrix, self._checks = parameters, matrix, CloudChecks()

    def check(self, message) -> list:
        """Return the warnings about a message."""
        return self._checks.look(message, self._matrix)

    def _problem_of(self, message) -> str:
        found = self.check(message)
        return found[0].text if found else no_points(message, self._matrix, self._parameters.input)

    def scan(self, message) -> Scan:
        """Return the scan of a message; raise a ScanError if it is damaged."""
        scan = scan_from_cloud(message, self._matrix, self._parameters.input)
        self.problem = '' if scan.valid.any() else self._problem_of(message)
        return scan
