"""Every parameter of the method: default, unit, bounds and one line of help, in one place.

ROS descriptors, YAML files, the command-line help and the parameter reference are made from these
classes. A full name is ``group.field``, for example ``rotation.sigma``.
"""
import dataclasses
import math
from dataclasses import dataclass

from .errors import ParameterError


def parameter(default, help, unit='', minimum=None, maximum=None, choices=None):
    """A dataclass field that knows what it means."""
    return dataclasses.field(default=default, metadata={
        'help': help, 'unit': unit, 'minimum': minimum, 'maximum': maximum, 'choices': choices})


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


class ParameterGroup:
    """A frozen dataclass of parameters that checks each value as it is made."""

    def __post_init__(self):
        for field in dataclasses.fields(self):
            value = check(_describe('', field), getattr(self, field.name))
            object.__setattr__(self, field.name, value)


class ParameterTree:
    """A frozen dataclass of parameter groups, read and made by full names."""

    @classmethod
    def describe(cls) -> tuple:
        """A `Description` of every parameter, in order."""
        return tuple(_describe(f'{group.name}.', field)
                     for group in dataclasses.fields(cls)
                     for field in dataclasses.fields(group.default_factory))

    def flatten(self) -> dict:
        """Full name -> value."""
        return {f'{group.name}.{field.name}': getattr(getattr(self, group.name), field.name)
                for group in dataclasses.fields(self)
                for field in dataclasses.fields(group.default_factory)}

    def replace(self, values):
        """A copy with `values` (full name -> value) changed, all or none.

        Raises
        ------
        ParameterError
            When a name is unknown, or a value has the wrong type or lies outside its bounds.
        """
        descriptions = {d.name: d for d in self.describe()}
        changes = {}
        for name, value in values.items():
            if name not in descriptions:
                raise ParameterError(f'unknown parameter {name!r}; {_nearest(name, descriptions)}')
            group, _, field = name.partition('.')
            changes.setdefault(group, {})[field] = check(descriptions[name], value)
        return dataclasses.replace(self, **{
            group: dataclasses.replace(getattr(self, group), **fields) for group, fields in changes.items()})


def check(description, value):
    """`value` in the parameter's own type.

    Raises
    ------
    ParameterError
        When it has another type or lies outside its bounds.
    """
    d = description
    if d.type is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if type(value) is not d.type:
        raise ParameterError(f'{d.name} = {value!r}: expected {_article(d.type)}')
    if d.type is float and not math.isfinite(value):
        raise ParameterError(f'{d.name} = {value!r}: expected a finite number')
    if d.choices is not None and value not in d.choices:
        raise ParameterError(f'{d.name} = {value!r}: expected one of {", ".join(map(repr, d.choices))}')
    if d.minimum is not None and value < d.minimum or d.maximum is not None and value > d.maximum:
        raise ParameterError(f'{d.name} = {value!r}: expected {_interval(d)}')
    return value


def _describe(prefix, field):
    m = field.metadata
    return Description(prefix + field.name, type(field.default), field.default, m['help'], m['unit'],
                       m['minimum'], m['maximum'], m['choices'])


def _interval(d):
    unit = f' {d.unit}' if d.unit else ''
    if d.maximum is None:
        return f'at least {d.minimum}{unit}'
    if d.minimum is None:
        return f'at most {d.maximum}{unit}'
    return f'{d.minimum} to {d.maximum}{unit}'


def _article(kind):
    return {float: 'a number', int: 'a whole number', bool: 'true or false', str: 'a text'}[kind]


def _nearest(name, names):
    import difflib
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    return f'did you mean {close[0]!r}?' if close else 'see the parameter reference for the names'


@dataclass(frozen=True)
class ScanParameters(ParameterGroup):
    """Which returns of a scan are used."""

    range_min: float = parameter(0.0, 'returns nearer than this are ignored; 0: the sensor\'s own limit', 'm', 0.0, 1000.0)
    range_max: float = parameter(0.0, 'returns farther than this are ignored; 0: the sensor\'s own limit', 'm', 0.0, 1000.0)


@dataclass(frozen=True)
class Parameters(ParameterTree):
    """All parameters of the registration and the odometry."""

    scan: ScanParameters = dataclasses.field(default_factory=ScanParameters)
