# SPDX-License-Identifier: Apache-2.0
"""Comparison of a scan with all views of a map at all headings at once.

A scan is a table of how far it sees in each bearing: one row for each interval of the range, one column for each
bearing. Two tables are compared by the sum of the products of their entries. For all rotations of a table these sums
are its circular correlation along the bearing, computed by Fourier transforms (Cooley and Tukey 1965). A part of a turn
is compared with a whole one: columns without a beam are zero.
"""
import numpy as np
from numpy.typing import NDArray

BEARINGS = 60
"""Number of columns of a table; 6 deg."""
ROWS, ROW, OFFSET = 16, 0.2, 1.0
"""Number of rows, and the step from one to the next of ``log(range + OFFSET)``: views are up to half a metre away from
the sensor, which moves near surfaces more than one row and far ones less."""
LEAST_SEEN = 0.2
"""Where this fraction of the bearings of a scan, or less, is known in a view, its similarity is at most a half."""
BLUR = 1.0
"""Standard deviation in rows of the error of a range, due to the distance of the view."""


class Signatures:
    """The tables of V views.

    Parameters
    ----------
    ranges : (V, BEARINGS) float
        Range [m] of each view along evenly spaced bearings from -pi on; infinite without a return.
    """

    def __init__(self, ranges: NDArray[np.float64]) -> None:
        rows = np.arange(ROWS)[:, None]
        with np.errstate(invalid='ignore'):
            table = np.exp(-0.5 * ((np.log(ranges + OFFSET)[:, None] / ROW - rows) / BLUR) ** 2)
        table[~np.isfinite(table)] = 0.0
        self._spectra = np.fft.rfft(table, axis=2).astype(np.complex64)
        self._known = np.fft.rfft(np.isfinite(ranges), axis=1)

    def compare(self, ranges: NDArray[np.float64], bearings: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compare a scan with all views.

        Parameters
        ----------
        ranges, bearings : (N,) float
            Ranges [m] and bearings [rad] of the returns of the scan.

        Returns
        -------
        (V, BEARINGS) float
            Mean over the bearings that both have of how well the ranges agree, 0..1, if the heading of the scan in the
            frame of the view is 0, 6, ... 354 deg; less where few bearings are common.
        """
        column = np.round((bearings + np.pi) / (2.0 * np.pi) * BEARINGS).astype(int) % BEARINGS
        row = np.clip(np.log(ranges + OFFSET) / ROW, 0.0, ROWS - 1.001)
        table, low = np.zeros((ROWS, BEARINGS)), row.astype(int)
        np.add.at(table, (low, column), 1.0 - row + low)
        np.add.at(table, (low + 1, column), row - low)
        seen = table.sum(axis=0) > 0.0
        table[:, seen] /= table[:, seen].sum(axis=0)
        spectrum = np.fft.rfft(table, axis=1).conj().astype(np.complex64)
        agreeing = np.fft.irfft(np.einsum('vkf,kf->vf', self._spectra, spectrum), BEARINGS, axis=1)
        common = np.fft.irfft(self._known * np.fft.rfft(seen).conj(), BEARINGS, axis=1)
        return agreeing / (common + max(LEAST_SEEN * np.count_nonzero(seen), 1.0))
