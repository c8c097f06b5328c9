# SPDX-License-Identifier: Apache-2.0
"""Lookup tables of several key frames, stacked so that one call looks points up in all of them."""
import cmath
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...features.free_space import FreeSpaceProfile, bins
from ...features.likelihood_field import LikelihoodField
from ...features.oriented_points import OrientedPoints
from ...geometry.se2 import SE2


class _Grids(NamedTuple):
    """Grids of K likelihood fields.

    Attributes
    ----------
    scale : (K, 1) complex [1/m]
        Factor that rotates from the odometry frame into the frame of each key frame, and scales to cells.
    corner : (K, 1) complex
        Corner of each grid relative to the odometry frame, in cells.
    last : (2, K, 1) int
        Last row and last column of each grid.
    """

    scale: NDArray[np.complex128]
    corner: NDArray[np.complex128]
    last: NDArray[np.intp]


class LikelihoodFieldStack:
    """Likelihood fields of K key frames: row k of an array of points is looked up in field k.

    Parameters
    ----------
    fields : sequence of LikelihoodField
    origins : (K, 1) complex [m]
        Positions of the key frames in the odometry frame.
    rotations : (K, 1) complex
        Unit numbers that rotate from the odometry frame into the frame of each key frame.

    Attributes
    ----------
    fields : tuple of LikelihoodField
    compiled_tables : object or None
        The tables of the fields in the form that the compiled look-up needs; None before its first use.
    """

    def __init__(self, fields: Sequence[LikelihoodField], origins: NDArray[np.complex128],
                 rotations: NDArray[np.complex128]):
        self.fields, self._origins, self._rotations = tuple(fields), origins, rotations
        self.compiled_tables: object | None = None

    @cached_property
    def _sizes(self) -> NDArray[np.intp]:
        """``(K,)``: number of points of each field, no point included."""
        return np.array([len(field.normals) for field in self.fields])

    @cached_property
    def first(self) -> NDArray[np.intp]:
        """``(K,)``: index of the first point of each field in the concatenated arrays."""
        first: NDArray[np.intp] = np.cumsum(self._sizes) - self._sizes
        return first

    @cached_property
    def normals(self) -> NDArray[np.complex128]:
        """``(N,)`` conjugated normals of all fields, as `LikelihoodField.normals`."""
        return np.concatenate([field.normals for field in self.fields])

    @cached_property
    def offsets(self) -> NDArray[np.float64]:
        """``(N,)`` `LikelihoodField.offsets` of all fields [m]."""
        return np.concatenate([field.offsets for field in self.fields])

    @cached_property
    def along(self) -> NDArray[np.float64]:
        """``(N,)`` `LikelihoodField.along` of all fields [m]."""
        return np.concatenate([field.along for field in self.fields])

    @cached_property
    def extents(self) -> NDArray[np.float64]:
        """``(N,)`` `LikelihoodField.extents` of all fields [m]."""
        return np.concatenate([field.extents for field in self.fields])

    @cached_property
    def _grids(self) -> _Grids:
        """The grids of the fields."""
        scale = self._rotations / np.array([[field.cell] for field in self.fields])
        corner = self._origins * scale + np.array([[field.origin / field.cell] for field in self.fields])
        return _Grids(scale, corner, np.array([field.shape for field in self.fields]).T[:, :, None] - 1)

    def nearest(self, points: NDArray[np.complex128]) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
        """Find the nearest map point of each of the `points` ``(K, P)`` [m, odometry frame]; M points have one.

        Returns
        -------
        index : (M,) int
            Index of the point in the flattened `points`.
        row : (M,) int
            Row of the point in `points`, which is the index of the key frame.
        nearest : (M,) int
            Index of the nearest map point in `normals`, `offsets`, `along` and `extents`.
        """
        grids = self._grids
        cells = points * grids.scale
        cells -= grids.corner
        cells, column = cells.real.astype(np.intp), cells.imag.astype(np.intp)
        for part, last in zip((cells, column), grids.last, strict=True):
            np.maximum(part, 0, out=part)
            np.minimum(part, last, out=part)
        cells *= grids.last[1] + 1
        cells += column
        # One table after the other: they are too large to be concatenated.
        found = np.concatenate([field.index[cell] for field, cell in zip(self.fields, cells, strict=True)])
        found = found.reshape(cells.shape)
        index = (found != self._sizes[:, None] - 1).ravel().nonzero()[0]
        row = index // cells.shape[1]
        return index, row, found.take(index) + self.first.take(row)


class FreeSpaceStack:
    """Free-space profiles of K key frames.

    Parameters
    ----------
    profiles : sequence of FreeSpaceProfile
    origins, rotations : (K, 1) complex
        Positions and rotations of the key frames, as for `LikelihoodFieldStack`.

    Attributes
    ----------
    near : (N,) float [m]
        `FreeSpaceProfile.nearby` of all profiles.
    size, first : (K, 1) int
        Number of bins of each profile, and index of its first bin in `near`.
    """

    def __init__(self, profiles: Sequence[FreeSpaceProfile], origins: NDArray[np.complex128],
                 rotations: NDArray[np.complex128]):
        near = [profile.nearby for profile in profiles]
        self.origins, self.rotations = origins, rotations
        self.near = np.concatenate(near)
        self.size = np.array([[len(each)] for each in near])
        self.first = self.size.cumsum(axis=0) - self.size

    def contains(self, points: OrientedPoints, pose: SE2, margin: float) -> NDArray[np.bool_]:
        """Determine which points of a scan lie in space that at least one key frame observed as free.

        Parameters
        ----------
        points : OrientedPoints
            P points of the scan.
        pose : SE2
            Pose of the scan in the odometry frame.
        margin : float [m]
            A point is in free space if it is nearer to the key frame than the returns there by more than this; the
            margin is larger for points with more noise.

        Returns
        -------
        (P,) bool
        """
        offsets = cmath.rect(1.0, pose.theta) * points.points + complex(pose.x, pose.y) - self.origins
        offsets *= self.rotations
        depth = self.near.take(self.first + bins(offsets, self.size))
        depth -= np.abs(offsets)
        in_front: NDArray[np.bool_] = (depth > points.tolerance(margin)).any(axis=0)
        return in_front
