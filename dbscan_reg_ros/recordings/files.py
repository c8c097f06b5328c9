# SPDX-License-Identifier: Apache-2.0
"""Atomic writing of files, and the reason why a file cannot be read."""
import gzip
import os
import zlib
from contextlib import contextmanager
from pathlib import Path

UNREADABLE = OSError, EOFError, zlib.error, UnicodeDecodeError
"""Errors of reading a file, plain or gzip, text or binary."""


@contextmanager
def replacing(path, binary=False):
    """Provide a text or `binary` file to write to; it replaces the file at `path` once it is complete.

    Missing folders above it are made.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(path.name + '.part')
    try:
        with open(unfinished, 'wb') if binary else open(unfinished, 'w', encoding='utf-8') as file:
            yield file
        os.replace(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)


def reason_of(error) -> str:
    """Return the reason for one of the errors `UNREADABLE`, and the remedy, in one line."""
    if isinstance(error, (EOFError, gzip.BadGzipFile, zlib.error)):
        return 'the gzip file is cut off or damaged; copy it again from its source'
    if isinstance(error, UnicodeDecodeError):
        return 'expected a text file in UTF-8'
    return error.strerror or str(error)
