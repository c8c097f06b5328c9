# SPDX-License-Identifier: Apache-2.0
"""The Intel Research Lab log with its references, as the benchmarks need it."""
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from dbscan_reg_ros.core.errors import RecordingError
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.recordings import data_folder, load_relations, open_recording


@dataclass(frozen=True)
class Intel:
    """The folder ``intel`` of the data.

    Raises a RecordingError when a file that is asked for cannot be read.
    """

    folder: Path

    @classmethod
    def below(cls, data=None) -> 'Intel':
        """Return the folder ``intel`` below `data`, or where it is by default."""
        return cls(data_folder(data) / 'intel')

    @cached_property
    def recording(self):
        """The recording of the log."""
        return open_recording(self.folder / 'intel.log.gz')

    @cached_property
    def scans(self) -> list:
        """Every `Scan` in log order."""
        return list(self.recording.scans())

    @cached_property
    def stamps(self):
        """``(N,)`` int64 stamps [ns]."""
        return np.array([scan.stamp for scan in self.scans], dtype=np.int64)

    @cached_property
    def relations(self):
        """The `Relations` of ``intel.relations``."""
        return load_relations(self.folder / 'intel.relations')

    @cached_property
    def pairs(self) -> list:
        """(reference index, current index, truth) of ``pairs.csv``."""
        return [(int(row[0]), int(row[1]), SE2(*row[2:5])) for row in self._table('pairs.csv')]

    @cached_property
    def reference(self):
        """(N, 3) true pose of each scan, from ``reference.csv``."""
        return self._table('reference.csv')[:, 1:4]

    def index(self, stamp) -> int:
        """Return the scan of that `stamp` [ns]."""
        return int(np.abs(self.stamps - stamp).argmin())

    def _table(self, name):
        try:
            return np.loadtxt(self.folder / name, delimiter=',', skiprows=1)
        except (OSError, ValueError) as error:
            raise RecordingError(f'{self.folder / name}: cannot be read: {error}') from error
