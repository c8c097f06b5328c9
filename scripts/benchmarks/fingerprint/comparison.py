# SPDX-License-Identifier: Apache-2.0
"""Records of two source trees, compared to the last bit."""
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Comparison:
    """Two records of one drive.

    Attributes
    ----------
    drive : str
    count : int
        Scans, or pairs.
    differing : (N,) bool
        Which of them are not the same to the last bit.
    largest : dict
        Name of what was recorded -> largest difference, of all that differ; for texts how many differ.
    """

    drive: str
    count: int
    differing: np.ndarray
    largest: dict = field(default_factory=dict)

    @property
    def first(self):
        """The first that differs; None where none does."""
        return int(self.differing.argmax()) if self.differing.any() else None

    def __str__(self):
        if self.first is None:
            return 'equal'
        largest = ', '.join(f'{name} {value:.3g}' for name, value in self.largest.items())
        return f'{self.differing.sum()} differ, from {self.first} on; largest difference: {largest}'


def compare(drive, theirs, ours) -> Comparison:
    """Two records, bit for bit; what is not a number in both is the same."""
    with np.load(theirs, allow_pickle=False) as first, np.load(ours, allow_pickle=False) as second:
        records = [{name: file[name] for name in file.files} for file in (first, second)]
    count = len(records[0]['pose'])
    differing, largest = np.zeros(count, dtype=bool), {}
    for name in records[0]:
        a, b = (record[name].reshape(count, -1) for record in records)
        other = different(a, b)
        if other.any():
            differing |= other.any(axis=1)
            largest[name] = float(other.sum()) if a.dtype.kind == 'U' else float(np.nanmax(
                np.where(other, np.abs(np.nan_to_num(a) - np.nan_to_num(b)), 0.0)))
    return Comparison(drive, count, differing, largest)


def different(a, b):
    """Where two arrays of texts, or of floats, are not equal to the last bit."""
    if a.dtype.kind == 'U':
        return a != b
    return (a.view(np.int64) != b.view(np.int64)) & ~(np.isnan(a) & np.isnan(b))
