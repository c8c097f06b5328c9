# SPDX-License-Identifier: Apache-2.0
"""Lidars that have names: each has parameters below its name, which are else inherited from those without a name."""
import dataclasses
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..core.errors import ParameterError
from ..core.parameters.features import ScanParameters
from ..core.parameters.schema import Description
from .parameter_groups import InputParameters

INHERITED = {'type': 'input.type', 'mounting': 'mounting', 'laser_pose': 'laser_pose', 'upside_down': 'upside_down',
             'mask': 'input.mask', 'mask_range': 'input.mask_range', 'time_offset': 'input.time_offset',
             'height_min': 'input.height_min', 'height_max': 'input.height_max', 'bearing_step': 'input.bearing_step',
             'range_min': 'scan.range_min', 'range_max': 'scan.range_max', 'noise_min': 'scan.noise_min',
             'noise_max': 'scan.noise_max', 'direction': 'scan.direction', 'revolution': 'scan.revolution',
             'stamp': 'scan.stamp'}
"""Parameter below the name of a lidar -> parameter from which it is inherited."""
OWN = 'topic', *INHERITED
"""Parameters below the name of a lidar."""
FRAME_MARK = ':'
"""Between the topic and the frame of scans in the name of one of several lidars on a topic; no topic contains it."""
NAMELESS = ('',)
"""Value of the parameter ``sensors`` if the lidars have no names: they are those of ``scan_topics``."""


@dataclass(frozen=True)
class LidarParameters:
    """Parameters of one lidar, from either form."""

    topic: str
    input: InputParameters
    """With the mask, the time offset and the type of this lidar."""
    scan: ScanParameters
    """Limits of its ranges and of its range noise."""
    mounting: str
    laser_pose: tuple[float, ...]
    """[m, m, rad]"""
    upside_down: bool
    """As the parameters of these names."""
    name: str = field(default='', compare=False)
    """Its name in ``sensors``; empty if it has none."""


def name_in_frame(topic: str, frame: str) -> str:
    """Return the name of the lidar whose scans on a `topic` have this `frame`."""
    return f'{topic}{FRAME_MARK}{frame}'


def is_named(names: object) -> bool:
    """Whether a value of the parameter ``sensors`` is a list of names."""
    return isinstance(names, Sequence) and not isinstance(names, str) and tuple(names) != NAMELESS and all(
        isinstance(name, str) for name in names)


def sensor_descriptions(names: Any, plain: Sequence[Description]) -> dict[str, Description]:
    """Map the full name of each parameter of the lidars `names` to its description; `plain` are those of the node."""
    known = {each.name: each for each in plain}
    found = {}
    for name in names if is_named(names) else ():
        found[f'{name}.topic'] = Description(f'{name}.topic', str, f'{name}/scan', f'Topic of the scans of {name}.', '',
                                             None, None, None, True, '')
        for own, inherited in INHERITED.items():
            text = f'The parameter {inherited} of {name}. If it is not given, the value of {inherited} applies.'
            if own == 'mounting':
                text = f'The parameter mounting of {name}. If it is not given, it is laser_pose if {name}.laser_pose ' \
                       'is given, else the value of mounting.'
            found[f'{name}.{own}'] = dataclasses.replace(known[inherited], name=f'{name}.{own}', help=text)
    return found


def check_names(names: Sequence[str], plain: Sequence[Description]) -> None:
    """Raise a ParameterError unless each of the `names` can stand before a dot."""
    groups = {each.name.partition('.')[0] for each in plain}
    for name in names:
        if not re.fullmatch('[A-Za-z][A-Za-z0-9_]*', name) or name in groups:
            raise ParameterError(f'sensors = {list(names)}: expected names of letters, digits and underscores that no '
                                 f'other parameter begins with, not {name!r}')
    if len(set(names)) < len(names):
        raise ParameterError(f'sensors = {list(names)}: expected each name once')


def sensor_values(name: str, given: Mapping[str, Any], plain: Mapping[str, Any]) -> dict[str, Any]:
    """Map each of the `OWN` parameters of the lidar `name` to its value: the one `given`, else the `plain` one."""
    return {own: _value_of(name, own, given, plain) for own in OWN}


def _value_of(name: str, own: str, given: Mapping[str, Any], plain: Mapping[str, Any]) -> Any:
    if (full := f'{name}.{own}') in given:
        return given[full]
    if own == 'topic':
        return f'{name}/scan'
    if own == 'mounting' and f'{name}.laser_pose' in given:
        return 'laser_pose'
    return plain[INHERITED[own]]
