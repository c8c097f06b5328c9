# SPDX-License-Identifier: Apache-2.0
"""Whether the compiled modules are there and were built from the present sources."""
import hashlib
from functools import lru_cache
from importlib import import_module
from pathlib import Path

from .core.errors import BuildError

SOURCES = Path(__file__).absolute().parent


def source_hash(folder: Path = SOURCES) -> str:
    """Return the hash of the sources of the compiled modules in a `folder`; empty where they are not installed."""
    paths = sorted(path for suffix in ('pyx', 'pxd') for path in folder.rglob(f'*.{suffix}'))
    return hashlib.sha256(b''.join(path.read_bytes() for path in paths)).hexdigest()[:16] if paths else ''


@lru_cache(maxsize=1)
def check_build() -> None:
    """Raise BuildError if the compiled modules are missing, or were built from other sources."""
    try:
        built = import_module(f'{__package__}.core.sources').SOURCE_HASH
    except ImportError as error:
        raise BuildError(f'the compiled modules of {__package__} are not built for this Python; {_REMEDY}, or install '
                         f'a wheel ({error})') from error
    if source_hash() not in ('', built):
        raise BuildError(f'the compiled modules of {__package__} were built from other sources; {_REMEDY}')


_REMEDY = f'in {SOURCES.parent}: python setup.py build_ext --inplace --force'
