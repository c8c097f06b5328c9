# SPDX-License-Identifier: Apache-2.0
"""Description of a parameter (default, unit, bounds, choices and help), and checks of its values."""
import contextlib
import dataclasses
import functools
import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar

from ..errors import ParameterError

Value: TypeAlias = 'float | int | bool | str | tuple[float, ...] | tuple[str, ...]'
"""Types that a parameter can have."""
Number = TypeVar('Number', bound=Value)
Tree = TypeVar('Tree', bound='ParameterTree')

ADVANCED = 'advanced.'
"""Prefix of the full names of parameters that are seldom changed."""


def parameter(default: Number, *, help: str, unit: str = '', case: str = '', read_only: bool = False,
              bounds: tuple[float, float] | tuple[str, ...] | None = None) -> Number:
    """Make a dataclass field with the description of a parameter.

    Parameters
    ----------
    default : float, int, bool, str or tuple of float or str
        If the default is a tuple of numbers, values are lists of as many numbers, or of a multiple of it: the numbers
        of several lidars, one after the other. If it is a tuple of texts, values are lists of one or more texts.
    help : str
        Whole sentences: what the parameter does, and what larger and smaller values cause.
    unit : str
    case : str
        What needs another value: a course of ``scripts/bench odometry``, a sensor, a robot or a symptom. A parameter
        with a case is advanced; one without depends on every sensor and robot, and is basic.
    read_only : bool
        The value cannot change after the start of the node.
    bounds : (float, float) or tuple of str, optional
        Least and greatest allowed value, both inclusive; of a text all allowed values.
    """
    choices = bounds if isinstance(default, str) else None
    minimum, maximum = bounds if bounds and not choices else (None, None)
    if type(default) is int and bounds is not None:
        minimum, maximum = int(bounds[0]), int(bounds[1])
    return dataclasses.field(default=default, metadata={
        'help': help, 'unit': unit, 'minimum': minimum, 'maximum': maximum, 'choices': choices, 'read_only': read_only,
        'case': case})


def internal(default: Any) -> Any:
    """Make a dataclass field of a `ParameterTree` that is no parameter."""
    return dataclasses.field(default=default, metadata={'internal': True})


@dataclass(frozen=True)
class Description:
    """Description of one parameter, with its full name.

    Attributes
    ----------
    name : str
        Full name: ``group.field``, or ``advanced.group.field`` if it is seldom changed.
    type : type
        `float`, `int`, `bool`, `str` or `tuple`.
    default : float, int, bool, str or tuple of float
    help, unit : str
    minimum, maximum : float or None
        Bounds, both inclusive.
    choices : tuple of str or None
    read_only : bool
    case : str
        What needs an advanced parameter; empty for a basic one.
    """

    name: str
    type: type
    default: Value
    help: str
    unit: str
    minimum: float | None
    maximum: float | None
    choices: tuple[str, ...] | None
    read_only: bool
    case: str

    @property
    def bounds(self) -> str:
        """Allowed values in words; empty where every value of the type is allowed."""
        if self.choices is not None:
            return f'one of {", ".join(map(repr, self.choices))}'
        unit = f' {self.unit}' if self.unit else ''
        if self.minimum is not None and self.maximum is not None:
            return f'{self.minimum} to {self.maximum}{unit}'
        if self.minimum is not None:
            return f'at least {self.minimum}{unit}'
        return '' if self.maximum is None else f'at most {self.maximum}{unit}'

    def allows(self, value: Any) -> bool:
        """Whether a `value` of the right type is one of the choices and within the bounds."""
        if self.choices is not None and value not in self.choices:
            return False
        return (self.minimum is None or value >= self.minimum) and (self.maximum is None or value <= self.maximum)


@dataclass(frozen=True)
class ParameterGroup:
    """A frozen dataclass of parameters that checks every value when an instance is made."""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = check(_describe(field.name, field), getattr(self, field.name))
            object.__setattr__(self, field.name, value)


@dataclass(frozen=True)
class ParameterTree:
    """A frozen dataclass of parameters and groups of parameters that can be read and changed by full name.

    In Python a parameter is the attribute ``group.field``, whether it is basic or advanced.
    """

    def __repr__(self) -> str:
        """Show the parameters that differ from their defaults."""
        values = self.flatten()
        changed = {each.name: values[each.name] for each in self.describe() if values[each.name] != each.default}
        return f'{type(self).__name__}()' + (f'.replace({changed})' if changed else '')

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            if not _is_group(field) and not _is_internal(field):
                object.__setattr__(self, field.name, check(_describe(field.name, field), getattr(self, field.name)))

    @classmethod
    def describe(cls) -> tuple[Description, ...]:
        """Return a `Description` of every parameter, in order."""
        tree: Any = cls
        return _descriptions(tree)

    def descriptions(self) -> tuple[Description, ...]:
        """Return a `Description` of every parameter that `flatten` contains, in order."""
        return self.describe()

    def flatten(self) -> dict[str, Value]:
        """Map the full name of every parameter to its value."""
        tree: Any = type(self)
        return {name: getattr(getattr(self, group) if group else self, field.name)
                for name, group, field in _parameter_fields(tree)}

    def replace(self: Tree, values: Mapping[str, object]) -> Tree:
        """Make a copy with `values` (full name -> value) changed, all or none.

        Raises
        ------
        ParameterError
            When a name is unknown, a value has the wrong type or is out of bounds, or two values contradict each other.
        """
        return dataclasses.replace(self, **self._changed_fields(values))

    def _changed_fields(self, values: Mapping[str, object]) -> dict[str, Any]:
        """Return the dataclass fields that are changed by `values`; errors are those of `replace`."""
        tree: Any = type(self)
        known = {name: (group, field) for name, group, field in _parameter_fields(tree)}
        own: dict[str, Any] = {}
        groups: dict[str, dict[str, Any]] = {}
        for name, value in values.items():
            if name not in known:
                raise ParameterError(unknown(name, known))
            group, field = known[name]
            (groups.setdefault(group, {}) if group else own)[field.name] = check(_describe(name, field), value)
        return own | {group: dataclasses.replace(getattr(self, group), **fields) for group, fields in groups.items()}


def check(description: Description, value: object) -> Any:
    """Return `value` in the type of the described parameter.

    Raises
    ------
    ParameterError
        When `value` has another type or lies outside the bounds.
    """
    d = description
    if d.type is tuple:
        return _check_list(d, value)
    if d.type is float and type(value) is int:
        with contextlib.suppress(OverflowError):
            value = float(value)
    if type(value) is not d.type:
        raise ParameterError(f'{d.name} = {_shown(value)}: expected {_article(d.type)}')
    if isinstance(value, float) and not math.isfinite(value):
        raise ParameterError(f'{d.name} = {value!r}: expected a finite number')
    if not d.allows(value):
        raise ParameterError(f'{d.name} = {value!r}: expected {d.bounds}')
    return value


def _check_list(d: Description, values: Any) -> tuple[Any, ...]:
    default: Any = d.default
    if isinstance(default[0], str):
        if isinstance(values, str) or not hasattr(values, '__len__') or not len(values) or not (
                all(values) or tuple(values) == default):
            raise ParameterError(f'{d.name} = {_shown(values)}: expected a list of one or more texts')
        default = default[:1]
    if isinstance(values, str) or not hasattr(values, '__len__') or not len(values) or len(values) % len(default):
        raise ParameterError(f'{d.name} = {_shown(values)}: expected '
                             f'{f"{len(default)} numbers" if len(default) > 1 else "a list of numbers"}')
    each = dataclasses.replace(d, type=type(default[0]))
    return tuple(check(dataclasses.replace(each, name=f'{d.name}[{i}]'), value) for i, value in enumerate(values))


def _shown(value: Any) -> str:
    """Format a value as a user writes it: arrays of any library as the list of their numbers."""
    if hasattr(value, 'tolist'):
        value = value.tolist()
    return repr(list(value) if isinstance(value, (tuple, bytes, bytearray)) else value)


def _is_group(field: 'dataclasses.Field[Any]') -> bool:
    return field.default is dataclasses.MISSING


def _is_internal(field: 'dataclasses.Field[Any]') -> bool:
    return bool(field.metadata.get('internal'))


@functools.cache
def _descriptions(tree: Any) -> tuple[Description, ...]:
    return tuple(_describe(name, field) for name, _, field in _parameter_fields(tree))


@functools.cache
def _parameter_fields(tree: Any) -> 'tuple[tuple[str, str, dataclasses.Field[Any]], ...]':
    """Return (full name, group or '', dataclass field) of every parameter of the class `tree`, in order."""
    found = []
    for field in dataclasses.fields(tree):
        if _is_internal(field):
            continue
        group: Any = field.default_factory
        if _is_group(field):
            for inner in dataclasses.fields(group):
                level = ADVANCED if inner.metadata['case'] else ''
                found.append((f'{level}{field.name}.{inner.name}', field.name, inner))
        else:
            found.append((field.name, '', field))
    return tuple(found)


def _describe(name: str, field: 'dataclasses.Field[Any]') -> Description:
    default: Any = field.default
    return Description(name, type(default), default, **field.metadata)


def _article(kind: type) -> str:
    return {float: 'a number', int: 'a whole number', bool: 'true or false', str: 'a text'}[kind]


_OF_PAPER = frozenset((
    'advanced.filter.slope_tolerance', 'advanced.filter.jump', 'advanced.segments.corners',
    'advanced.segments.corner_thresholds', 'advanced.segments.corner_penalty', 'advanced.segments.sections',
    'advanced.rotation.directed', 'advanced.rotation.weighted', 'advanced.rotation.clustering',
    'advanced.rotation.median_scale', 'advanced.translation.form', 'advanced.translation.clustering',
    'advanced.selection.method', 'divergence.bandwidth', 'advanced.divergence.grid'))
"""Parameters of earlier versions."""


_FIXED: dict[str, object] = {
    'filter.inner_threshold': 2, 'filter.outer_threshold': 3, 'filter.relative_tolerance': 0.01,
    'segments.split_distance': 0.03, 'segments.split_levels': 6, 'segments.join_noise': 2.5, 'segments.join_gap': 1.0,
    'segments.normal_reach': 0.1, 'segments.normal_beams': 2, 'translation.max_pairs': 14, 'density.max_cells': 800,
    'density.violation_tolerance': 0.15, 'selection.preselection_points': 60, 'selection.wide_search_score': 0.5,
    'selection.landmark_size': 1.0, 'selection.same_distance': 0.05, 'selection.same_angle': 0.02,
    'rotation.eps_min': 0.005, 'rotation.eps_max': 0.05, 'translation.parallel_sigma': 0.06,
    'refinement.coarse_scale': 0.25, 'refinement.fine_scale': 0.1, 'refinement.final_scale': 0.03,
    'refinement.map_iterations': 4, 'refinement.polish_spread': 1.6, 'degeneracy.min_points': 2,
    'decision.rival_distance': 0.2, 'decision.rival_angle': 0.09, 'manhattan.wall_sigma': 0.012,
    'manhattan.correlation_distance': 20.0, 'manhattan.direction_sigma': 0.035, 'manhattan.min_aligned_ratio': 0.5,
    'segments.depth_margin': 0.15, 'segments.normal_noise': 4.0, 'translation.min_crossing_sine': 0.35,
    'refinement.score_scale': 0.05, 'degeneracy.search_distance': 1.0, 'decision.weak_prior_sigma': 0.5,
    'prior.stamp_jitter': 0.3, 'odometry.movable_weight': 0.03, 'odometry.static_baseline': 0.5,
    'density.min_normal_cosine': 0.5, 'density.leverage_ridge': 1.0, 'segments.max_segments': 100,
    'refinement.coarse_iterations': 3, 'refinement.fine_iterations': 2}
"""Parameters of earlier versions, without `ADVANCED`, that no sensor, robot or building needs -> their fixed value."""
_GONE = {'calibrate_mountings': 'mountings are not changed while driving; set the values that the diagnostics and '
                                'calibrate give',
         'translation.max_width': 'clusters of translations are never clustered again'}
"""Parameters of earlier versions, without `ADVANCED` -> why they are gone."""
_RENAMED = {'odometry.prior': 'prior.source'}
"""Parameters of earlier versions, without `ADVANCED` -> what they are now."""


def gone(name: str, names: Collection[str]) -> str:
    """Say what one of `names` is that a parameter of earlier versions is now, or why it is gone; else empty."""
    plain = name.removeprefix(ADVANCED)
    if name in _OF_PAPER:
        return (f'{name} belongs to the method of the paper, which has no parameters any more; run it with --method '
                'paper (register, compare)')
    if plain in _GONE:
        return f'{name} is gone: {_GONE[plain]}'
    if plain in _FIXED:
        return f'{name} is no parameter any more: it is {_FIXED[plain]} for every sensor, robot and building'
    plain = _RENAMED.get(plain, plain)
    return next((f'{name} is now {other}' for other in (plain, f'{ADVANCED}{plain}') if other in names), '')


def unknown(name: str, names: Collection[str]) -> str:
    """Say that none of `names` is `name`: what it is now, why it is gone, or which one was meant."""
    return gone(name, names) or f'unknown parameter {name!r}; {suggest(name, names)}'


def suggest(name: str, names: Iterable[str]) -> str:
    """Suggest which of `names` was meant by the unknown `name`, as the end of a message."""
    import difflib
    shortened = {each.removeprefix(ADVANCED): each for each in names}
    close = difflib.get_close_matches(name.removeprefix(ADVANCED), shortened, n=1, cutoff=0.5)
    return f'did you mean {shortened[close[0]]!r}?' if close else 'see the parameter reference for the names'
