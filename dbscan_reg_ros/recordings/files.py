# SPDX-License-Identifier: Apache-2.0
"""Atomic writing of files: a file is complete or does not appear."""
import os
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing(path, binary=False):
    """Provide a text or `binary` file to write to; it replaces the file at `path` once it is complete."""
    path = Path(path)
    unfinished = path.with_name(path.name + '.part')
    try:
        with open(unfinished, 'wb') if binary else open(unfinished, 'w', encoding='utf-8') as file:
            yield file
        os.replace(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)
