# SPDX-License-Identifier: Apache-2.0
"""Choice of the default backend of the registration: the compiled steps, or the numpy reference for tests."""
import hashlib
import os
from functools import lru_cache
from importlib import import_module
from pathlib import Path

from .core.backend import REFERENCE, Backend
from .core.errors import BuildError
from .core.parameters.tree import Parameters

PURE = 'DBSCAN_REG_PURE'
"""Environment variable that chooses the numpy reference if it is set to anything but 0."""
SOURCES = Path(__file__).absolute().parent / 'core'


def source_hash(folder: Path = SOURCES) -> str:
    """Return the hash of the sources of the compiled steps in a `folder`; empty where they are not installed."""
    paths = sorted(path for suffix in ('pyx', 'pxd', 'pxi') for path in folder.rglob(f'*.{suffix}'))
    return hashlib.sha256(b''.join(path.read_bytes() for path in paths)).hexdigest()[:16] if paths else ''


@lru_cache(maxsize=1)
def compiled_backend() -> Backend:
    """Return the backend of the compiled steps; BuildError if they were built from other sources."""
    try:
        steps = import_module(f'{__package__}.core.accelerated.steps')
    except (AttributeError, ImportError) as error:
        raise BuildError(f'{_OTHER_SOURCES} ({error})') from error
    if source_hash() not in ('', steps.SOURCE_HASH):
        raise BuildError(_OTHER_SOURCES)
    return Backend('compiled', {name: getattr(steps, name) for name in steps.STEPS})


_OTHER_SOURCES = ('the compiled modules of dbscan_reg_ros were built from other sources; in its folder: '
                  'python setup.py build_ext --inplace --force')


@lru_cache(maxsize=1)
def choose() -> Backend:
    """Return the default backend: the compiled one, unless `PURE` chooses the reference."""
    compiled = compiled_backend()
    return REFERENCE if os.environ.get(PURE, '0') not in ('', '0') else compiled


def reference_settings(parameters: Parameters) -> list[str]:
    """Return the names of parameters set to what no compiled step knows: the reference runs the steps of these."""
    rotation, translation = parameters.rotation, parameters.translation
    settings = {
        'rotation.min_samples': rotation.min_samples > 1,
        'translation.min_samples': translation.min_samples > 1,
    }
    return [name for name, is_set in settings.items() if is_set]
