# SPDX-License-Identifier: Apache-2.0
"""Choice of the default backend: the compiled steps if they are built and up to date, else the numpy reference."""
import hashlib
import os
import warnings
from functools import lru_cache
from importlib import import_module
from pathlib import Path

from .core.backend import REFERENCE, Backend
from .core.parameters.tree import Parameters

PURE = 'DBSCAN_REG_PURE'
"""Environment variable that chooses the numpy reference if it is set to anything but 0."""
SOURCES = Path(__file__).absolute().parent / 'core' / 'accelerated'


def source_hash(folder: Path = SOURCES) -> str:
    """Return the hash of the sources of the compiled steps in a `folder`; empty where they are not installed."""
    paths = sorted(path for suffix in ('pyx', 'pxi') for path in folder.rglob(f'*.{suffix}'))
    return hashlib.sha256(b''.join(path.read_bytes() for path in paths)).hexdigest()[:16] if paths else ''


@lru_cache(maxsize=1)
def compiled_backend() -> Backend | None:
    """Return the backend of the compiled steps; None if they are not built, or were built from other sources."""
    name = f'{__package__}.core.accelerated.steps'
    steps = None
    try:
        steps = import_module(name)
    except ModuleNotFoundError as missing:
        if missing.name == name:
            return None
    except Exception:  # noqa: BLE001 - built from other sources, they may refer to names that are gone
        pass
    if steps is None or source_hash() not in ('', steps.SOURCE_HASH):
        warnings.warn('the compiled steps were built from other sources: the slower numpy reference runs instead; to '
                      'build them again: python setup.py build_ext --inplace --force', RuntimeWarning, stacklevel=2)
        return None
    return Backend('compiled', {name: getattr(steps, name) for name in steps.STEPS})


@lru_cache(maxsize=1)
def choose() -> Backend:
    """Return the default backend: the compiled one if it can run and `PURE` does not forbid it, else the reference."""
    pure = os.environ.get(PURE, '0') not in ('', '0')
    return REFERENCE if pure else compiled_backend() or REFERENCE


def reference_settings(parameters: Parameters) -> list[str]:
    """Return the names of parameters set to what no compiled step knows: the reference runs the steps of these."""
    rotation, translation = parameters.rotation, parameters.translation
    settings = {
        'rotation.min_samples': rotation.min_samples > 1,
        'translation.min_samples': translation.min_samples > 1,
    }
    return [name for name, is_set in settings.items() if is_set]
