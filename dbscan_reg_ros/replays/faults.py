# SPDX-License-Identifier: Apache-2.0
"""Faults while results are written: collected, so that a fault of one result does not prevent the others."""
import traceback
from contextlib import contextmanager


class Faults:
    """Collects the results that could not be written, with the reasons: ``explain(error)`` returns one in one line.

    With `verbose` the traceback of every fault is printed.
    """

    def __init__(self, explain, verbose=False):
        self._explain, self._verbose = explain, verbose
        self._reasons = {}

    @property
    def lines(self) -> list:
        """One line for each part of the results that could not be written, with the first reason."""
        return [f'{part} not written: {reason}' for part, reason in self._reasons.items()]

    @contextmanager
    def noted(self, part):
        """Record an error in the ``with`` block as a fault of `part`, and continue after the block."""
        try:
            yield
        except Exception as error:  # noqa: BLE001 - any fault: the other parts are still written
            self._note(part, error)

    def attempt(self, part, function, *args):
        """Return the result of `function(*args)`; None if it fails, which is recorded, or if `part` failed before."""
        if part in self._reasons:
            return None
        try:
            return function(*args)
        except Exception as error:  # noqa: BLE001 - any fault: the other parts are still written
            self._note(part, error)

    def _note(self, part, error):
        if self._verbose:
            traceback.print_exception(error)
        self._reasons.setdefault(part, self._explain(error))
