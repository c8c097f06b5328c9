# SPDX-License-Identifier: Apache-2.0
"""Search space: the parameters that are searched, and their possible values."""
import math
from dataclasses import dataclass

from ..core.errors import ParameterError
from ..core.parameters.schema import check, unknown

FACTOR = 5.0
"""Without a range, a number is searched between its default divided by this and multiplied by this."""
LOG_RATIO = 3.0
"""Ranges whose bounds have a greater ratio than this are searched on a logarithmic scale."""


@dataclass(frozen=True)
class Axis:
    """One parameter of the search space."""

    name: str
    """Full name of the parameter."""
    kind: type
    """float, int, bool or str."""
    low: float = 0.0
    high: float = 0.0
    """Bounds of a number."""
    choices: tuple = ()
    """Values of a parameter that is not a number."""

    @property
    def is_log(self):
        """Whether the values are searched on a logarithmic scale."""
        return self.low > 0.0 and self.high / self.low > LOG_RATIO

    def at(self, share):
        """Return the value at the fraction `share` (0..1) of the range of this parameter."""
        if self.choices:
            return self.choices[min(int(share * len(self.choices)), len(self.choices) - 1)]
        value = self.low * (self.high / self.low) ** share if self.is_log else self.low + share * (self.high - self.low)
        return round(value) if self.kind is int else float(f'{value:.4g}')


def read_axis(text, parameters) -> Axis:
    """Read an axis from ``NAME`` or ``NAME=LOW:HIGH``.

    Raises a ParameterError when the name is unknown, the parameter cannot be searched, or the range is invalid.
    """
    name, _, given = text.partition('=')
    d = _searchable(name, parameters)
    if d.type is bool or d.choices:
        if given:
            raise ParameterError(f'{text}: {name} has no range; every value is tried')
        return Axis(name, d.type, choices=tuple(d.choices or (False, True)))
    low, high = _read_range(text, given) if given else _usual_range(d)
    if d.type is int:
        low, high = math.ceil(low), math.floor(high)
    if not low < high:
        raise ParameterError(f'{text}: expected a lower bound below the upper one')
    for value in (low, high):
        check(d, d.type(value))
    return Axis(name, d.type, low, high)


def _searchable(name, parameters):
    """Return the description of the parameter `name`; raise ParameterError if it cannot be searched."""
    descriptions = {d.name: d for d in parameters.describe()}
    if name not in descriptions:
        raise ParameterError(unknown(name, descriptions))
    d = descriptions[name]
    if d.read_only or (not d.choices and d.type not in (int, float, bool)):
        raise ParameterError(f'{name}: cannot be searched')
    return d


def _read_range(text, given):
    try:
        low, high = (float(word) for word in given.split(':'))
    except ValueError:
        raise ParameterError(f'{text}: expected NAME=LOW:HIGH') from None
    return low, high


def _usual_range(d):
    """Choose bounds around the default, within the bounds of the parameter."""
    if d.default <= 0:
        raise ParameterError(f'{d.name}: its default is {d.default}; give a range, {d.name}=LOW:HIGH')
    return (max(d.default / FACTOR, -math.inf if d.minimum is None else d.minimum),
            min(d.default * FACTOR, math.inf if d.maximum is None else d.maximum))
