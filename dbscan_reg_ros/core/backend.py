# SPDX-License-Identifier: Apache-2.0
"""Backends: implementations of the steps of the method, either the numpy reference or the compiled steps."""
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar, cast

Step = TypeVar('Step', bound=Callable[..., Any])


@dataclass(frozen=True, eq=False)
class Backend:
    """Implementation of the steps of the method.

    Attributes
    ----------
    name : str
    compiled : mapping
        Name of a function of the reference -> its compiled counterpart.
    """

    name: str
    compiled: Mapping[str, Callable[..., Any]] = field(default_factory=dict, repr=False)

    def step(self, reference: Step) -> Step:
        """Return the compiled counterpart of a function of the reference, or the function itself if it has none."""
        return cast(Step, self.compiled.get(reference.__name__, reference))


REFERENCE = Backend('reference')
"""The backend that runs the numpy functions."""


class _Default:
    """The function that chooses the default backend; the package sets it once, when it is imported."""

    source: Callable[[], Backend] = staticmethod(lambda: REFERENCE)


def set_default_source(source: Callable[[], Backend]) -> None:
    """Set the function that chooses the default backend."""
    _Default.source = staticmethod(source)


def default_backend() -> Backend:
    """Return the backend that runs the steps if the caller passes none."""
    return _Default.source()
