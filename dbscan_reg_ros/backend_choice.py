# SPDX-License-Identifier: Apache-2.0
"""Choice of the default backend of the registration: the compiled steps, or the numpy reference for tests."""
import os
from functools import lru_cache
from importlib import import_module

from .build_check import check_build
from .core.backend import REFERENCE, Backend
from .core.parameters.tree import Parameters

PURE = 'DBSCAN_REG_PURE'
"""Environment variable that chooses the numpy reference if it is set to anything but 0."""


@lru_cache(maxsize=1)
def compiled_backend() -> Backend:
    """Return the backend of the compiled steps; BuildError if they were built from other sources."""
    check_build()
    steps = import_module(f'{__package__}.core.accelerated.steps')
    return Backend('compiled', {name: getattr(steps, name) for name in steps.STEPS})


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
