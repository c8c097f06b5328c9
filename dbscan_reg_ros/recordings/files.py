# SPDX-License-Identifier: Apache-2.0
"""Files that appear whole or not at all."""
import os
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing(path, binary=False):
    """Provide a file to write to, text or `binary`, that takes the place of `path` once it is complete."""
    path = Path(path)
    unfinished = path.with_name(path.name + '.part')
    try:
        with open(unfinished, 'wb') if binary else open(unfinished, 'w', encoding='utf-8') as file:
            yield file
        os.replace(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)
