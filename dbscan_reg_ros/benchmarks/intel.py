"""The Intel Research Lab log with its references, as the benchmarks need it."""
import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ..core.errors import RecordingError
from ..core.se2 import SE2
from ..recordings import open_recording


def data_folder(data=None) -> Path:
    """The folder that holds ``intel/``: `data`, else $DBSCAN_REG_DATA, else ``../shared/data`` beside the project."""
    folder = Path(data or os.environ.get('DBSCAN_REG_DATA') or Path(__file__).resolve().parents[3] / 'shared' / 'data')
    if not (folder / 'intel').is_dir():
        raise RecordingError(f'{folder}: no folder intel in it; name the data with --data DIR or $DBSCAN_REG_DATA')
    return folder


@dataclass(frozen=True)
class Intel:
    """The folder ``intel`` of the data."""

    folder: Path

    @cached_property
    def scans(self) -> list:
        """Every `Scan` in log order."""
        return list(open_recording(self.folder / 'intel.log.gz').scans())

    @cached_property
    def pairs(self) -> list:
        """(reference index, current index, truth) of ``pairs.csv``."""
        rows = np.genfromtxt(self.folder / 'pairs.csv', delimiter=',', skip_header=1)
        return [(int(row[0]), int(row[1]), SE2(*row[2:5])) for row in rows]

    @cached_property
    def relations(self) -> list:
        """(reference index, current index, truth, seconds between) of ``intel.relations``."""
        rows = np.loadtxt(self.folder / 'intel.relations')
        stamps = np.array([scan.stamp for scan in self.scans]) / 1e9
        first, second = ([int(np.abs(stamps - t).argmin()) for t in rows[:, column]] for column in (0, 1))
        return [(i, j, SE2(row[2], row[3], row[7]), float(row[1] - row[0]))
                for i, j, row in zip(first, second, rows)]
