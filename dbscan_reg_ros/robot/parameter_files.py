# SPDX-License-Identifier: Apache-2.0
"""Parameter files for ``--params-file``, and the parameter reference.

``python -m dbscan_reg_ros.robot.parameter_files`` prints the default parameters as a parameter file; with ``--write``
it regenerates ``config/scan_matcher.yaml`` and ``doc/parameters.md`` in the source tree.
"""
import argparse
import inspect
import itertools
import re
import sys
import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml

from ..core.errors import ParameterError
from ..core.parameters.schema import ADVANCED, Description, ParameterGroup
from ..paths import check_file, parameter_file, ready_made
from .parameters import NodeParameters, is_ros_parameter

SOURCE = Path(__file__).parents[2]
DEFAULTS_FILE = SOURCE / 'config' / 'scan_matcher.yaml'
REFERENCE_FILE = SOURCE / 'doc' / 'parameters.md'
NODE_NAME = 'scan_matcher'
WIDTH = 120
INDENT = '  '
LARGEST = 2**20
"""Largest number of characters of a parameter file."""
DEFAULTS = NodeParameters()

HEAD = """\
The parameters of scan_matcher with their defaults.
Made by `python -m dbscan_reg_ros.robot.parameter_files --write`. To set other values, copy this file, and keep only
the lines of the parameters that you change."""

REFERENCE_HEAD = """\
# Parameters

This page lists all parameters of `scan_matcher` with their defaults. The basic ones come first; they depend on the
sensor and the robot. The advanced ones are seldom changed: each names what needs it, a course of
`scripts/bench odometry`, a sensor, a robot or a [symptom](tuning.md#from-symptom-to-parameter). Every command that
takes `--params-file` accepts the same parameters of the method. In Python they are attributes of `Parameters`, without
the prefix `advanced.`. [method.md](method.md) describes the steps of the method that use the parameters.
[node.md](node.md) describes how to set them.

Made by `python -m dbscan_reg_ros.robot.parameter_files --write`, as is
[config/scan_matcher.yaml](../config/scan_matcher.yaml); a test compares this page and that file with the program.
"""


def read_parameters(path: str | Path | Sequence[str | Path], node: str = NODE_NAME) -> NodeParameters:
    """Read the parameters that a file sets for `node`; all other parameters have their defaults.

    `path` is the path of a parameter file, or the name of a ready-made one, such as ``lds``; or several of
    these, of which a later one takes precedence.

    A section has the name of the node, with or without its namespace, or a wildcard (``/**``). The parts of a
    parameter's name may be nested or joined by dots. Sections of other nodes are ignored.

    Raises
    ------
    ParameterError
        When the file cannot be read, is not a parameter file, has no section for `node`, or sets a parameter that is
        unknown or has a wrong value.
    """
    paths = [path] if isinstance(path, (str, Path)) else path
    values = {name: value for each in paths for name, value in _values(each, node).items()}
    try:
        return NodeParameters().replace({k: v for k, v in values.items() if not is_ros_parameter(k)})
    except ParameterError as error:
        raise ParameterError(f'{", ".join(map(str, paths))}: {error}') from None


def _values(path: str | Path, node: str) -> dict[str, Any]:
    """Return the full names and the values of the parameters that a file sets for `node`."""
    sections = dict(_sections(_load(parameter_file(path)), path))
    own = [section for name, section in sections.items() if name.split('/')[-1] in (node, '*', '**')]
    if not own:
        raise ParameterError(f'{path}: no parameters for {node!r}, only for {", ".join(sections)}; '
                             "expected a section '/**' or one named after the node")
    return {name: value for section in own for name, value in _flatten(section)}


def write_parameters(path: str | Path, parameters: NodeParameters = DEFAULTS, head: str = HEAD) -> None:
    """Write `parameters` to the file at `path`, each parameter with its help, unit and bounds as a comment."""
    Path(path).write_text(format_parameters(parameters, head), encoding='utf-8')


def format_parameters(parameters: NodeParameters = DEFAULTS, head: str = HEAD) -> str:
    """Format `parameters` as a parameter file: first parameters without a group, then basic, then advanced ones."""
    values = parameters.flatten()
    lines = [f'# {line}' for line in head.splitlines()] + ['/**:', '  ros__parameters:']
    current: list[str] = []
    for d in _ordered(parameters):
        *groups, field = d.name.split('.')
        same = [group for group, last in zip(groups, current, strict=False) if group == last]
        lines += [f'{INDENT * (2 + depth)}{groups[depth]}:' for depth in range(len(same), len(groups))]
        current, indent = groups, INDENT * (2 + len(groups))
        lines += _comment(d, indent)
        lines.append(f'{indent}{field}: {_scalar(values[d.name])}')
    return '\n'.join(lines) + '\n'


def format_reference() -> str:
    """Format the parameter reference as Markdown: one table for each group, the node's own parameters first."""
    lines = [REFERENCE_HEAD]
    for group, descriptions in itertools.groupby(_ordered(DEFAULTS), key=lambda d: d.name.rpartition('.')[0]):
        case = group.startswith(ADVANCED)
        lines += [f'## `{group}`' if group else '## The node', '', _about(group), '',
                  '| name | default | values | meaning |' + ' needed by |' * case, '|---|---|---|---|' + '---|' * case]
        lines += [f'| `{d.name}` | `{_scalar(d.default)}` | {describe_limits(d)} | {d.help} |' + f' {d.case} |' * case
                  for d in descriptions]
        lines.append('')
    return '\n'.join(lines[:-1]) + '\n'


def describe_limits(description: Description) -> str:
    """Return the bounds of a parameter, or its unit if it has no bounds, and whether it is read-only."""
    bounds = description.bounds or description.unit
    return '; '.join(filter(None, [bounds, 'read-only' if description.read_only else '']))


class _Loader(yaml.SafeLoader):
    """Reads YAML as ROS does, without aliases: a few lines of nested aliases would expand without limit."""

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Compose a YAML node; raise a YAML error for an alias."""
        if self.check_event(yaml.AliasEvent):
            raise yaml.MarkedYAMLError(problem='an alias is used; expected the value itself',
                                       problem_mark=self.peek_event().start_mark)
        return super().compose_node(parent, index)


class _Dumper(yaml.SafeDumper):
    """Writes YAML that `_Loader` reads to the same values."""


for _yaml in (_Loader, _Dumper):
    # 1e-3 is a number in ROS, and a text in YAML 1.1.
    _yaml.add_implicit_resolver('tag:yaml.org,2002:float', re.compile(r'^[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$'),
                                list('-+.0123456789'))


def _load(path: str | Path) -> Any:
    """Parse a YAML file."""
    check_file(path, ParameterError)
    try:
        with open(path, encoding='utf-8') as file:
            text = file.read(LARGEST + 1)
        if len(text) > LARGEST:
            raise ParameterError(f'{path}: more than {LARGEST} characters; expected a file of parameters')
        return yaml.load(text, _Loader)
    except FileNotFoundError as error:
        raise ParameterError(f'{path}: cannot be read: {error.strerror}; expected the path of a parameter '
                             f'file, or the name of a ready-made one: {", ".join(ready_made())}') from None
    except OSError as error:
        raise ParameterError(f'{path}: cannot be read: {error.strerror}') from None
    except UnicodeDecodeError:
        raise ParameterError(f'{path}: no valid YAML: expected a text file in UTF-8') from None
    except yaml.YAMLError as error:
        where = getattr(error, 'problem_mark', None)
        line = f', line {where.line + 1}' if where else ''
        raise ParameterError(f'{path}{line}: no valid YAML: {getattr(error, "problem", error)}') from None
    except (RecursionError, ValueError) as error:
        raise ParameterError(f'{path}: no valid YAML: {error}') from None


def _sections(tree: Any, path: str | Path, prefix: str = '') -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield (name of the node, parameters) of every section of a parameter file; namespaces may be nested."""
    if not isinstance(tree, dict) or not tree:
        raise ParameterError(f'{path}: {prefix or "the file"} has no section; expected '
                             "'/**: ros__parameters: ...' or the node's name in place of '/**'")
    for name, section in tree.items():
        name = f'{prefix}/{name}'.replace('//', '/')
        if isinstance(section, dict) and 'ros__parameters' in section:
            parameters = section['ros__parameters'] or {}
            if not isinstance(parameters, dict):
                raise ParameterError(f'{path}: {name}: {parameters!r}: expected names with values')
            yield name, parameters
        else:
            yield from _sections(section, path, name)


def _flatten(section: dict[str, Any], prefix: str = '') -> Iterator[tuple[str, Any]]:
    """Yield the full name and the value of every parameter of a section, in the order of the file."""
    for name, value in section.items():
        if isinstance(value, dict):
            yield from _flatten(value, f'{prefix}{name}.')
        else:
            yield f'{prefix}{name}', value


def _ordered(parameters: NodeParameters) -> list[Description]:
    """Descriptions of all parameters: first parameters without a group, then the basic and the advanced ones."""
    return sorted(parameters.descriptions(), key=lambda d: ('.' in d.name, d.name.startswith(ADVANCED)))


def _about(group: str) -> str:
    """Describe a group of parameters with the docstrings of its class and of the base classes."""
    if not group:
        return 'Frames, and the mounting of the laser on the base.'
    classes = inspect.getmro(type(getattr(DEFAULTS, group.removeprefix(ADVANCED))))
    return ' '.join(c.__doc__ or '' for c in reversed(classes[:classes.index(ParameterGroup)]))


def _comment(description: Description, indent: str) -> list[str]:
    limits = describe_limits(description)
    text = description.help + (f' [{limits}]' if limits else '')
    start = f'{indent}# '
    return textwrap.wrap(text, WIDTH, initial_indent=start, subsequent_indent=start, break_on_hyphens=False)


def _scalar(value: Any) -> str:
    value = list(value) if isinstance(value, tuple) else value
    text: str = yaml.dump(value, Dumper=_Dumper, default_flow_style=True, width=10_000)
    return text.split('\n')[0]


def main(argv: Sequence[str] | None = None) -> int:
    """Print the default parameters; with ``--write``, write the parameter files of the source tree instead."""
    parser = argparse.ArgumentParser(prog='python -m dbscan_reg_ros.robot.parameter_files',
                                     description='Print the default parameters as a parameter file.')
    parser.add_argument('--write', action='store_true',
                        help=f'write {DEFAULTS_FILE.name} and {REFERENCE_FILE.name} in the source tree')
    if parser.parse_args(argv).write:
        write_parameters(DEFAULTS_FILE)
        REFERENCE_FILE.write_text(format_reference(), encoding='utf-8')
    else:
        sys.stdout.write(format_parameters())
    return 0


if __name__ == '__main__':
    sys.exit(main())
