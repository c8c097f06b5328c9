# SPDX-License-Identifier: Apache-2.0
"""A replay in the map of a file: where the sensor is, what else it may be, and the picture of the map."""
import dataclasses
import math
from typing import NamedTuple

import numpy as np

from ..core.errors import ScanError
from ..core.odometry.records import OdometryUpdate
from ..figures.plots import CELLS, DensityMap
from ..places.grid import Grid
from ..places.localizer import Localizer, State
from ..places.map_files import load_grid
from ..recordings.poses import compose
from ..robot.occupancy import FREE

LEAST = 0.01
"""Candidates that are less probable are not kept."""
FREE_INK = 0.13
"""Ink of free cells, that the known part of the map is seen."""


class Moment(NamedTuple):
    """What is known of the pose in the map at one scan.

    Attributes
    ----------
    state : State
    covariance : (3, 3) float
        Of the pose, for (x, y, theta) in the map [m, m, rad]; 0 unless localised.
    places : (C, 4) float
        Poses of the sensor in the map and their probabilities [m, m, rad, 1], the most probable first: one if it is
        localised, otherwise the candidates.
    """

    state: State
    covariance: np.ndarray
    places: np.ndarray


class OdometryInMap:
    """An odometry whose poses are those in the map of a file; scans at which these are not known are not used.

    Parameters
    ----------
    odometry : Odometry or ReplayOdometry
    file : Path
        The map.
    parameters : Parameters
        Those of the odometry.
    """

    def __init__(self, odometry, file, parameters):
        self._odometry, self._localizer = odometry, Localizer(load_grid(file, parameters), parameters)

    def process(self, scan) -> OdometryUpdate:
        """Return the update with the pose in the map; raise a ScanError where it is not known."""
        update = self._odometry.process(scan)
        found = self._localizer.process(update)
        if found.state is not State.LOCALISED:
            raise ScanError(f'pose in the map: {found.state.value}')
        return dataclasses.replace(update, pose=found.pose, covariance=found.covariance)


class InMap:
    """Localises the scans of a replay in the map of a file.

    Parameters
    ----------
    file : Path
        The map.
    parameters : Parameters
        Those of the odometry.
    yaw : float
        Angle [rad] by which `lidars.turned` rotated the scans before the odometry.

    Attributes
    ----------
    moments : list of Moment
        One for each scan.
    """

    def __init__(self, file, parameters, yaw=0.0):
        self._grid, self._yaw = load_grid(file, parameters), yaw
        self._localizer = Localizer(self._grid, parameters)
        self.moments: list[Moment] = []
        self._stamps, self._way, self._last, self._first = list[int](), 0.0, None, math.inf

    def add(self, update):
        """Localise the scan of an `OdometryUpdate`."""
        found, pose = self._localizer.process(update), update.pose
        self._way += math.hypot(pose.x - self._last.x, pose.y - self._last.y) if self._last else 0.0
        self._last = pose
        self._stamps.append(update.stamp)
        covariance, places = np.zeros((3, 3)), found.hypotheses
        if found.state is State.LOCALISED:
            self._first = min(self._first, self._way)
            covariance, places = found.covariance, [(found.pose, 1.0 - found.elsewhere)]
        rows = [(*place.as_tuple(), odds) for place, odds in places if odds >= LEAST]
        self.moments.append(Moment(found.state, covariance, np.array(rows).reshape(-1, 4)))

    @property
    def localised(self) -> list[int]:
        """Numbers of the scans at which the sensor is localised."""
        return [number for number, moment in enumerate(self.moments) if moment.state is State.LOCALISED]

    def trajectory(self):
        """Return the stamps (N,) [ns] of the `localised` scans, and the poses (N, 3) of the sensor in the map.

        The axes of the sensor are turned to those of the robot.
        """
        poses = [self.moments[number].places[0, :3] for number in self.localised]
        return [self._stamps[number] for number in self.localised], np.array(poses).reshape(-1, 3)

    def places(self, number):
        """Return the `Moment.places` of a scan, with the axes of the sensor as they are in the recording."""
        rows = self.moments[number].places
        turned = compose(rows[:, :3], np.array([[0.0, 0.0, self._yaw]]))
        return np.column_stack((turned, rows[:, 3]))

    def measures(self, known) -> dict:
        """Return how soon it was localised, the number of scans in each state, and the errors against a `KnownMotion`.

        The errors are those of all `localised` poses, aligned with the truth as a whole.
        """
        states = [moment.state for moment in self.moments]
        found = {state.name.lower(): states.count(state) for state in State}
        if self.localised:
            poses = np.array([self.places(number)[0, :3] for number in self.localised])
            found |= {'first_m': self._first} | known.measures(self.trajectory()[0], poses)
        return {f'in_map_{name}': value for name, value in found.items()}

    def line(self, measures) -> str:
        """Return the summary of the `measures` in one line."""
        end = f'at the end {self.moments[-1].state.value}'
        if not self.localised:
            return f'never localised; {end}'
        share = 100.0 * len(self.localised) / (len(self.moments) - self.localised[0])
        error = ''.join(f'; {words} {measures[f"in_map_{name}"]:.3f} m' for name, words in
                        (('relations_all_mean_m', 'relations mean'), ('ate_m', 'position'))
                        if f'in_map_{name}' in measures)
        return f'localised after {self._first:.2f} m, and at {share:.1f} % of the scans from then on; {end}{error}'

    def picture(self) -> DensityMap:
        """Return the map: surfaces, and what is free."""
        return grid_picture(self._grid)


def grid_picture(grid: Grid) -> DensityMap:
    """Draw a grid in the frame of the map, with `CELLS` on the longer side at most."""
    height, width = (grid.resolution * np.array(grid.values.shape)).tolist()
    corners = grid.origin.apply(np.array([(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)]))
    low, high = corners.min(axis=0), corners.max(axis=0)
    cell = max(grid.resolution, (high - low).max() / CELLS)
    columns, rows = np.ceil((high - low) / cell).astype(int)
    x, y = np.meshgrid(low[0] + cell * (np.arange(columns) + 0.5), low[1] + cell * (np.arange(rows) + 0.5))
    at = grid.cells(np.column_stack((x.ravel(), y.ravel())))
    ink = np.where(grid.values.ravel()[at] == FREE, FREE_INK, 0.0)
    # Thick enough to be seen where the whole map is shown.
    ink[grid.distance.ravel()[at] <= cell] = 1.0
    extent = (low[0], low[0] + columns * cell, low[1], low[1] + rows * cell)
    return DensityMap(ink.reshape(rows, columns), extent)
