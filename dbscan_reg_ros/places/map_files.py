# SPDX-License-Identifier: Apache-2.0
"""Maps in files: of key frames, and occupancy grids as ``map_server`` of Nav2 reads them."""
import re
from pathlib import Path
from zipfile import is_zipfile

import numpy as np
import yaml

from ..core.geometry.se2 import SE2
from ..core.parameters.tree import Parameters
from ..paths import check_file
from ..recordings.trajectories import finite_numbers
from ..robot.occupancy import FREE, LARGEST, OCCUPIED, UNKNOWN
from .grid import Grid
from .map import Map, MapError

MODES = 'trinary', 'scale', 'raw'
"""Values of ``mode``. Of the cells between the thresholds, which only ``scale`` distinguishes, none is a surface."""
HEADER = re.compile(rb'(P[25])\s+{0}(\d+)\s+{0}(\d+)\s+{0}(\d+)\s'.replace(b'{0}', rb'(?:#[^\n]*\n\s*)*'))
"""Kind, width, height and the value of white of a PGM picture, with comments."""
ONE_BYTE = 255
"""Up to this value of white, a cell is one byte."""
_SHAPE = 2
"""Number of dimensions of a grey picture."""


def load_grid(path, parameters: Parameters = Parameters()) -> Grid:
    """Return the grid of a map file: a map of key frames (``.npz``), or the ``.yaml`` of an occupancy grid.

    Raises
    ------
    MapError
        When the file, or the picture that it names, cannot be read or is no map.
    """
    check_file(path, MapError)
    if Path(path).suffix not in ('.yaml', '.yml'):
        if Path(path).exists() and not is_zipfile(path):
            raise MapError(f'{path}: no map; expected a map of key frames (.npz, by replay --map-out or ~/save_map) '
                           'or the .yaml of an occupancy grid (by replay --grid or map_saver of Nav2), not its picture')
        return Grid.of_map(Map.load(path), parameters)
    try:
        fields = yaml.safe_load(Path(path).read_text(encoding='utf-8'))
        return _grid(fields, Path(path).parent)
    except OSError as error:
        named = f'{error.filename}: {error.strerror}' if error.strerror else ' '.join(str(error).split())
        raise MapError(f'{path}: cannot be read: {named}') from None
    except MapError:
        raise
    except Exception as error:  # noqa: BLE001 - a wrong file makes the parsers raise nearly anything
        reason = ' '.join(str(error).split())
        raise MapError(f'{path}: no map ({reason}); expected the .yaml of an occupancy grid, '
                       'as replay --grid or map_saver of Nav2 writes it') from None


def _grid(fields, folder) -> Grid:
    """Return the grid of the `fields` of a map.yaml in `folder`."""
    missing = [name for name in ('image', 'resolution', 'origin') if name not in (fields or ())]
    if missing:
        raise ValueError(f'it has no {" and no ".join(missing)}')
    mode = fields.get('mode', 'trinary')
    if mode not in MODES:
        raise ValueError(f'mode is {mode!r}; expected one of {", ".join(MODES)}')
    resolution, *origin = finite_numbers((fields['resolution'], *fields['origin']))
    if not resolution > 0.0:
        raise ValueError(f'resolution is {resolution:g}; expected more than 0')
    grey = _picture(folder / fields['image'])
    if grey.size > LARGEST:
        raise ValueError(f'{grey.size} cells; expected at most {LARGEST}')
    if mode == 'raw':
        occupied, free = grey == OCCUPIED, grey < OCCUPIED
        free &= grey <= 100.0 * float(fields.get('free_thresh', 0.25))
    else:
        # Dark cells are occupied, unless the picture is a negative.
        share = grey / 255.0 if int(fields.get('negate', 0)) else (255.0 - grey) / 255.0
        occupied = share > float(fields.get('occupied_thresh', 0.65))
        free = share < float(fields.get('free_thresh', 0.25))
    values = np.full(grey.shape, UNKNOWN, dtype=np.int8)
    values[free], values[occupied] = FREE, OCCUPIED
    # The first row of the picture is that of the greatest y.
    return Grid(values[::-1], SE2.from_array(origin), resolution)


def _picture(path):
    """Return the grey values (H, W) 0..255 of a picture; a transparent cell is grey 205, unknown."""
    check_file(path, MapError)
    if path.suffix == '.pgm':
        return _pgm(path.read_bytes())
    try:
        from matplotlib.image import imread
    except ImportError:
        raise MapError(f'{path}: pictures other than .pgm need matplotlib: pip install matplotlib') from None
    values = np.asarray(imread(path), dtype=float) * 255.0
    if values.ndim == _SHAPE:
        return values
    colours = 3 if values.shape[2] >= 3 else 1  # noqa: PLR2004 - red, green, blue
    grey = values[:, :, :colours].mean(axis=2)
    return grey if values.shape[2] == colours else np.where(values[:, :, colours] > 0.0, grey, 205.0)


def _pgm(content):
    """Return the grey values (H, W) 0..255 of a PGM picture, binary or in words."""
    header = HEADER.match(content)
    if not header:
        raise ValueError(f'the picture begins with {content[:9]!r}; expected the header of a PGM, P5 or P2')
    width, height, white = (int(number) for number in header.groups()[1:])
    rest = content[header.end():]
    if header[1] == b'P2':
        values = np.array(rest.split(), dtype=float)
    else:
        values = np.frombuffer(rest, dtype=np.uint8 if white <= ONE_BYTE else '>u2').astype(float)
    if not width * height or len(values) < width * height:
        raise ValueError(f'the picture has {len(values)} of {width} x {height} cells')
    return values[:width * height].reshape(height, width) * (255.0 / white)
