# SPDX-License-Identifier: Apache-2.0
"""Archives of numpy arrays and a JSON text, ``.npz`` files that are read without pickle: scans, snapshots, maps."""
import io
import json
import math
import zipfile
from dataclasses import dataclass

import numpy as np

from ..core.errors import DbscanRegError
from ..core.scan import Scan
from ..core.scan_geometry import ScanGeometry
from ..paths import check_file
from .files import replacing

LARGEST = 128 * 2**20
"""Maximum size of an unpacked archive [bytes]; 1000 scans of 4000 beams have 16 MB of ranges."""


@dataclass(frozen=True)
class Archive:
    """A kind of archive."""

    name: str
    """Name of the array that holds the bytes of the JSON text (UTF-8), and of the kind in messages."""
    format: str
    """Value of ``format`` in the JSON text."""
    version: int
    """The latest version, which is written; this one and those before are read."""
    origin: str
    """What writes such a file."""
    error: type[DbscanRegError]
    """Type of the errors, derived from `DbscanRegError`."""

    def write(self, path, fields, arrays):
        """Write the JSON `fields` and the `arrays`, name -> array; the file appears complete or not at all."""
        from importlib import metadata
        try:
            package = metadata.version('dbscan_reg_ros')
        except metadata.PackageNotFoundError:
            package = ''
        text = json.dumps({'format': self.format, 'version': self.version, 'package': package, **fields},
                          allow_nan=False)
        # In memory first: an archive that a full disk ends complains again when it is deleted.
        archive = io.BytesIO()
        np.savez_compressed(archive, **arrays, **{self.name: np.frombuffer(text.encode(), dtype=np.uint8)})
        with replacing(path, binary=True) as file:
            file.write(archive.getbuffer())

    def read(self, path, make):
        """Return what `make` makes of the JSON fields and the arrays of the file at `path`.

        Raises an error of the type `error`, of one line, when the file cannot be read or is of another kind.
        """
        check_file(path, self.error)
        try:
            arrays = self._arrays(path)
            fields = json.loads(arrays[self.name].tobytes().decode())
            if fields['format'] != self.format or not 1 <= fields['version'] <= self.version:
                raise self.error(f'{path}: {fields["format"]!r} version {fields["version"]}: expected '
                                 f'{self.format!r} version {self.version}')
            return make(fields, arrays)
        except OSError as error:
            raise self.error(f'{path}: cannot be read: {error.strerror or error}') from None
        except self.error:
            raise
        except Exception as error:  # noqa: BLE001 - a damaged archive makes numpy raise nearly anything
            reason = ' '.join(str(error).split())
            raise self.error(f'{path}: no {self.name} ({reason}); expected a file that {self.origin} wrote') from None

    def _arrays(self, path):
        """Return name -> array of the file; raise an error if it unpacks to more than `LARGEST` bytes."""
        with zipfile.ZipFile(path) as archive:
            size = sum(part.file_size for part in archive.infolist())
        if size > LARGEST:
            raise self.error(f'{path}: holds {size} bytes; expected at most {LARGEST}')
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}


def scan_fields(scans, arrays) -> list:
    """Return the JSON fields of `scans`; add their ranges to `arrays`, and their bearings where they are not uniform.

    The arrays of scan I are ``ranges_I``, float32 (N,) [m], and ``bearings_I``, float64 (N,) [rad].
    """
    fields = []
    for index, scan in enumerate(scans):
        geometry, limit = scan.geometry, scan.geometry.range_max
        arrays[f'ranges_{index}'] = scan.ranges
        if geometry.bearings_given is not None:
            arrays[f'bearings_{index}'] = geometry.bearings
        fields.append({'stamp': scan.stamp, 'frame_id': scan.frame_id, 'time_increment': scan.time_increment,
                       'angle_min': geometry.angle_min, 'angle_increment': geometry.angle_increment,
                       'range_min': geometry.range_min, 'range_max': limit if math.isfinite(limit) else None})
    return fields


def scans_of(all_fields, arrays) -> list:
    """Return the scans of the JSON fields and arrays that `scan_fields` made."""
    scans, geometry = [], None
    for index, fields in enumerate(all_fields):
        ranges, bearings = arrays[f'ranges_{index}'], arrays.get(f'bearings_{index}')
        limit = math.inf if fields['range_max'] is None else fields['range_max']
        geometry = ScanGeometry(fields['angle_min'], fields['angle_increment'], len(ranges), fields['range_min'], limit,
                                None if bearings is None else tuple(bearings.tolist())).reuse(geometry)
        scans.append(Scan(fields['stamp'], ranges, geometry, fields['time_increment'], fields['frame_id']))
    return scans
