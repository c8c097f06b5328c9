# SPDX-License-Identifier: Apache-2.0
"""What a parameter is: default, unit, bounds, choices and help, and how values are checked."""
import dataclasses
import math
from dataclasses import dataclass

from ..errors import ParameterError


def parameter(default, help, unit='', minimum=None, maximum=None, choices=None, read_only=False):
    """A dataclass field that knows what it means; a tuple of numbers as default is a list of that length."""
    return dataclasses.field(default=default, metadata={
        'help': help, 'unit': unit, 'minimum': minimum, 'maximum': maximum, 'choices': choices,
        'read_only': read_only})


@dataclass(frozen=True)
class Description:
    """What is known of one parameter by its full name."""

    name: str
    type: type
    default: object
    help: str
    unit: str
    minimum: float | None
    maximum: float | None
    choices: tuple | None
    read_only: bool

    @property
    def bounds(self) -> str:
        """The allowed values in words; empty where every value of the type is."""
        if self.choices is not None:
            return f'one of {", ".join(map(repr, self.choices))}'
        unit = f' {self.unit}' if self.unit else ''
        if self.minimum is not None and self.maximum is not None:
            return f'{self.minimum} to {self.maximum}{unit}'
        if self.minimum is not None:
            return f'at least {self.minimum}{unit}'
        return '' if self.maximum is None else f'at most {self.maximum}{unit}'


class ParameterGroup:
    """A frozen dataclass of parameters that checks each value as it is made."""

    def __post_init__(self):
        for field in dataclasses.fields(self):
            value = check(_describe('', field), getattr(self, field.name))
            object.__setattr__(self, field.name, value)


class ParameterTree:
    """A frozen dataclass of parameters and groups of parameters, read and made by full names."""

    def __post_init__(self):
        for field in dataclasses.fields(self):
            if not _is_group(field):
                object.__setattr__(self, field.name, check(_describe('', field), getattr(self, field.name)))

    @classmethod
    def describe(cls) -> tuple:
        """A `Description` of every parameter, in order."""
        return tuple(_describe(prefix, field) for prefix, field in _parameter_fields(cls))

    def flatten(self) -> dict:
        """Full name -> value."""
        return {prefix + field.name: getattr(getattr(self, prefix[:-1]) if prefix else self, field.name)
                for prefix, field in _parameter_fields(type(self))}

    def replace(self, values):
        """A copy with `values` (full name -> value) changed, all or none.

        Raises
        ------
        ParameterError
            When a name is unknown, a value has the wrong type or lies outside its bounds, or two contradict each other.
        """
        descriptions = {d.name: d for d in self.describe()}
        own, groups = {}, {}
        for name, value in values.items():
            if name not in descriptions:
                raise ParameterError(f'unknown parameter {name!r}; {suggest(name, descriptions)}')
            group, _, field = name.rpartition('.')
            (groups.setdefault(group, {}) if group else own)[field] = check(descriptions[name], value)
        return dataclasses.replace(self, **own, **{
            group: dataclasses.replace(getattr(self, group), **fields) for group, fields in groups.items()})


def check(description, value):
    """`value` in the parameter's own type.

    Raises
    ------
    ParameterError
        When it has another type or lies outside its bounds.
    """
    d = description
    if d.type is tuple:
        return _check_list(d, value)
    if d.type is float and type(value) is int and value.bit_length() < 1024:
        value = float(value)
    if type(value) is not d.type:
        raise ParameterError(f'{d.name} = {_shown(value)}: expected {_article(d.type)}')
    if d.type is float and not math.isfinite(value):
        raise ParameterError(f'{d.name} = {value!r}: expected a finite number')
    if (d.choices is not None and value not in d.choices or d.minimum is not None and value < d.minimum
            or d.maximum is not None and value > d.maximum):
        raise ParameterError(f'{d.name} = {value!r}: expected {d.bounds}')
    return value


def _check_list(d, values):
    if isinstance(values, str) or not hasattr(values, '__len__') or len(values) != len(d.default):
        raise ParameterError(f'{d.name} = {_shown(values)}: expected {len(d.default)} numbers')
    kind = type(d.default[0])
    return tuple(check(dataclasses.replace(d, name=f'{d.name}[{i}]', type=kind), value)
                 for i, value in enumerate(values))


def _shown(value):
    """A value as a user writes it: arrays of any library as the list of their numbers."""
    if hasattr(value, 'tolist'):
        value = value.tolist()
    return repr(list(value) if isinstance(value, (tuple, bytes, bytearray)) else value)


def _is_group(field):
    return field.default is dataclasses.MISSING


def _parameter_fields(tree):
    """(prefix of the full name, dataclass field) of every parameter of the class `tree`, in order."""
    for field in dataclasses.fields(tree):
        if _is_group(field):
            for inner in dataclasses.fields(field.default_factory):
                yield f'{field.name}.', inner
        else:
            yield '', field


def _describe(prefix, field):
    return Description(prefix + field.name, type(field.default), field.default, **field.metadata)


def _article(kind):
    return {float: 'a number', int: 'a whole number', bool: 'true or false', str: 'a text'}[kind]


def suggest(name, names) -> str:
    """Which of `names` was meant by the unknown `name`, as the end of a message."""
    import difflib
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    return f'did you mean {close[0]!r}?' if close else 'see the parameter reference for the names'
