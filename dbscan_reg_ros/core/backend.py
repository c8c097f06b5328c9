# SPDX-License-Identifier: Apache-2.0
"""One implementation of the steps: the numpy reference, or the compiled one. The package chooses the default."""
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
        Compiled counterparts by the names of the reference's functions.
    """

    name: str
    compiled: Mapping[str, Callable[..., Any]] = field(default_factory=dict, repr=False)

    def step(self, reference: Step) -> Step:
        """Return the compiled counterpart of a function of the reference; where there is none, the function itself."""
        return cast(Step, self.compiled.get(reference.__name__, reference))


REFERENCE = Backend('reference')
"""The numpy modules."""


class _Default:
    """Where the default backend comes from: the package sets it once, when it is imported."""

    source: Callable[[], Backend] = staticmethod(lambda: REFERENCE)


def set_default_source(source: Callable[[], Backend]) -> None:
    """Set the function that chooses the default backend."""
    _Default.source = staticmethod(source)


def default_backend() -> Backend:
    """Return the backend that runs where none is given."""
    return _Default.source()
