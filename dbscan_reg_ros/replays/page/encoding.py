# SPDX-License-Identifier: Apache-2.0
"""Arrays and pictures as texts that the script of a page reads."""
import base64
import io
import json

import numpy as np


def packed(values, kind='<f4') -> str:
    """Return an array as the base64 text of its little-endian bytes."""
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()


def rounded(values, digits=3) -> list:
    """Return an array as nested lists of numbers with at most `digits` decimals."""
    return np.round(np.asarray(values, dtype=float), digits).tolist()


def picture(ink) -> str:
    """Convert the density of each cell ``(rows, columns)``, 0..1, lowest row first, to the data URL of a PNG.

    The pixels of the PNG are black, and transparent if the density is 0.
    """
    from PIL import Image

    file = io.BytesIO()
    # 16 levels are enough for a density and halve the file.
    image = Image.fromarray(np.round(15.0 * np.asarray(ink, dtype=float)[::-1]).astype(np.uint8)).convert('L')
    image.putpalette([0, 0, 0] * 16)
    image.save(file, format='PNG', bits=4, transparency=bytes(range(0, 256, 17)), optimize=True)
    return 'data:image/png;base64,' + base64.b64encode(file.getvalue()).decode()


def script_json(content) -> str:
    """Return `content` as JSON that cannot end the script element around it."""
    return json.dumps(content, separators=(',', ':'), allow_nan=False).replace('<', '\\u003c')
