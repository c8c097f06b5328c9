# SPDX-License-Identifier: Apache-2.0
"""What is searched: parameters and the values that they may take."""
import math
from dataclasses import dataclass

from ..core.errors import ParameterError
from ..core.parameters.schema import check, suggest

FACTOR = 5.0
"""A number is searched between its default over this and its default times this, unless a range is given."""


@dataclass(frozen=True)
class Axis:
    """One parameter.

    Attributes
    ----------
    name : str
        Full name.
    kind : type
        float, int, bool or str.
    low, high : float
        Bounds of a number.
    choices : tuple
        The values of what is no number.
    """

    name: str
    kind: type
    low: float = 0.0
    high: float = 0.0
    choices: tuple = ()

    @property
    def is_log(self):
        """Searched by its order of magnitude."""
        return self.low > 0.0 and self.high / self.low > 3.0

    def at(self, share):
        """The value at `share`, 0..1, of the way through."""
        if self.choices:
            return self.choices[min(int(share * len(self.choices)), len(self.choices) - 1)]
        value = self.low * (self.high / self.low) ** share if self.is_log else self.low + share * (self.high - self.low)
        return round(value) if self.kind is int else float(f'{value:.4g}')


def read_axis(text, parameters) -> Axis:
    """The axis that ``NAME`` or ``NAME=LOW:HIGH`` says.

    Raises
    ------
    ParameterError
        When the name is unknown, no single value can be searched, or the range makes no sense.
    """
    name, _, given = text.partition('=')
    descriptions = {d.name: d for d in parameters.describe()}
    if name not in descriptions:
        raise ParameterError(f'unknown parameter {name!r}; {suggest(name, descriptions)}')
    d = descriptions[name]
    if d.read_only or not d.choices and d.type not in (int, float, bool):
        raise ParameterError(f'{name}: cannot be searched')
    if d.type is bool or d.choices:
        if given:
            raise ParameterError(f'{text}: {name} has no range; every value is tried')
        return Axis(name, d.type, choices=tuple(d.choices or (False, True)))
    if given:
        try:
            low, high = (float(word) for word in given.split(':'))
        except ValueError:
            raise ParameterError(f'{text}: expected NAME=LOW:HIGH') from None
    elif d.default > 0:
        low = max(d.default / FACTOR, -math.inf if d.minimum is None else d.minimum)
        high = min(d.default * FACTOR, math.inf if d.maximum is None else d.maximum)
    else:
        raise ParameterError(f'{name}: its default is {d.default}; say what to search, {name}=LOW:HIGH')
    if d.type is int:
        low, high = math.ceil(low), math.floor(high)
    if not low < high:
        raise ParameterError(f'{text}: expected a lower bound below the upper one')
    for value in (low, high):
        check(d, d.type(value))
    return Axis(name, d.type, low, high)
