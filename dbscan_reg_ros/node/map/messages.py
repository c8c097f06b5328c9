# SPDX-License-Identifier: Apache-2.0
"""Conversion of maps to messages, and from messages."""
import numpy as np
from geometry_msgs.msg import Point, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from ...places.grid import Grid
from ...places.pose_graph import PoseGraph
from ...recordings.message_fields import COLORS, filled, header_fields, pose_with_covariance_fields
from ...robot.base_state import InitialPose
from ...robot.occupancy import FREE, LARGEST, OCCUPIED, UNKNOWN
from ..interfaces.messages import planar_from_message
from ..interfaces.outputs import grid_message

FREE_UP_TO, OCCUPIED_FROM = 25, 65
"""Probabilities [%] up to which a cell is free, and from which on it is occupied: the defaults of ``map_saver``."""
POINT, LINE = 0.1, 0.02
"""Size of a key frame and width of a constraint [m]."""
CHAIN, LOOPS = COLORS['reference', 'matched'], COLORS['current', 'matched']


def pose_with_covariance(base: InitialPose, stamp: int, frame: str) -> PoseWithCovarianceStamped:
    """Make the message of a pose in `frame` at `stamp` [ns]."""
    return filled(PoseWithCovarianceStamped(), {
        'header': header_fields(stamp, frame),
        'pose': pose_with_covariance_fields(base.pose.as_array(), base.covariance)})


def grid_from_message(message: OccupancyGrid) -> Grid:
    """Convert a map; cells of which neither is probable are unknown.

    Raises
    ------
    ValueError
        When the sizes do not fit together.
    PoseError
        When the origin is not a valid pose.
    """
    info, values = message.info, np.array(message.data, dtype=np.int8)
    if not 0 < len(values) == info.width * info.height <= LARGEST:
        raise ValueError(f'{info.width} x {info.height} cells with {len(values)} values; expected as many values as '
                         f'cells, at most {LARGEST}')
    if not 0.0 < info.resolution < np.inf:
        raise ValueError(f'resolution is {info.resolution:g}; expected more than 0')
    cells = np.full(values.shape, UNKNOWN, dtype=np.int8)
    cells[(values >= 0) & (values <= FREE_UP_TO)] = FREE
    cells[values >= OCCUPIED_FROM] = OCCUPIED
    return Grid(cells.reshape(info.height, info.width), planar_from_message(info.origin), float(info.resolution))


def grid_to_message(grid: Grid, stamp: int, frame: str) -> OccupancyGrid:
    """Make the message of a grid, without its border, in `frame` at `stamp` [ns]."""
    return grid_message(grid.values[1:-1, 1:-1], grid.origin, grid.resolution, stamp, frame)


def graph_to_message(graph: PoseGraph, stamp: int, frame: str) -> MarkerArray:
    """Make markers of the key frames, of the constraints from one to the next, and of all others, the loops."""
    pairs = graph.constraints.pairs
    loops = np.abs(pairs[:, 1] - pairs[:, 0]) != 1
    parts = (('key frames', Marker.POINTS, POINT, CHAIN, np.arange(len(graph.poses))),
             ('chain', Marker.LINE_LIST, LINE, CHAIN, pairs[~loops].ravel()),
             ('loops', Marker.LINE_LIST, LINE, LOOPS, pairs[loops].ravel()))
    markers = []
    for name, kind, size, colour, numbers in parts:
        marker = filled(Marker(ns=name, type=kind, color=ColorRGBA(**colour)), {'header': header_fields(stamp, frame)})
        marker.action = Marker.ADD if len(numbers) else Marker.DELETE
        marker.pose.orientation.w, marker.scale.x, marker.scale.y = 1.0, size, size
        marker.points = [Point(x=x, y=y) for x, y in graph.poses[numbers, :2].tolist()]
        markers.append(marker)
    return MarkerArray(markers=markers)
