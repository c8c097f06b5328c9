# SPDX-License-Identifier: Apache-2.0
"""Results of a benchmark: tables, metrics, bounds and which are missed; versions and machine."""
import importlib.metadata
import math
import platform
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Bound:
    """The interval that a metric must lie in."""

    lowest: float = -math.inf
    highest: float = math.inf

    def holds(self, value):
        """Return whether the value is within the bound; False for `nan`, which was not measured."""
        return self.lowest <= value <= self.highest

    def __str__(self):
        if math.isinf(self.lowest):
            return f'at most {self.highest:g}'
        if math.isinf(self.highest):
            return f'at least {self.lowest:g}'
        return f'{self.lowest:g} to {self.highest:g}'


def at_least(limit) -> Bound:
    """Return a bound from below."""
    return Bound(lowest=limit)


def at_most(limit) -> Bound:
    """Return a bound from above."""
    return Bound(highest=limit)


PACKAGES = ('numpy', 'scipy', 'scikit-learn', 'small_gicp', 'kiss-icp')
SMALL = 0.1
"""Numbers below it are printed with four decimals."""


def machine() -> str:
    """Versions and machine in one line."""
    packages = [f'{name} {version}' for name in PACKAGES if (version := _version(name))]
    return f'python {platform.python_version()}, {", ".join(packages)}; {_processor()}'


@dataclass
class Report:
    """What a benchmark measured."""

    metrics: dict = field(default_factory=dict)
    """Method -> metric -> number."""
    missed: list[str] = field(default_factory=list)
    """One line for each bound that ours misses."""
    tables: list[str] = field(default_factory=list)

    def add(self, title, rows, bounds, shown=None, prefix=''):
        """Add a table of `rows` (method -> metric -> number), of the metrics `shown` or all of them.

        `bounds` (metric -> `Bound`) hold for the method ``dbscan``; the metrics are kept under `prefix`.
        """
        for method, row in rows.items():
            self.metrics.setdefault(method, {}).update({prefix + name: value for name, value in row.items()})
        ours = rows.get('dbscan', {})
        self.missed += [f'{prefix}{name} = {ours[name]:.4g}, expected {bound}'
                        for name, bound in bounds.items() if name in ours and not bound.holds(ours[name])]
        names = dict.fromkeys(name for row in rows.values() for name in row)
        names = [name for name in shown or names if name in names]
        self.tables.append(_table(title, names, rows))

    def add_courses(self, title, rows, method='dbscan', bounds=None):
        """Add a table of what one `method` did on several courses: `rows` is course -> metric -> number.

        `bounds` (course -> metric -> `Bound`) hold for the method ``dbscan``.
        """
        for course, wanted in (bounds or {}).items() if method == 'dbscan' else ():
            row = rows.get(course, {})
            self.missed += [f'{course}_{name} = {row[name]:.4g}, expected {bound}'
                            for name, bound in wanted.items() if name in row and not bound.holds(row[name])]
        self.metrics.setdefault(method, {}).update(
            {f'{course}_{name}': value for course, row in rows.items() for name, value in row.items()})
        names = list(dict.fromkeys(name for row in rows.values() for name in row))
        self.tables.append(_table(f'{title}, {method}', names, rows))

    def measured(self) -> dict:
        """Return the metrics without those that could not be measured."""
        return {method: {name: value for name, value in row.items() if not math.isnan(value)}
                for method, row in self.metrics.items()}


def _cell(name, value):
    if math.isnan(value):
        return '-'
    if name.endswith('_count'):
        return str(value)
    if name.endswith(('_m', '_mb', '_s', '_deg', 'nees', '_spread', '_kl')) or name.startswith(('ms', 'ratio')):
        return f'{value:.4f}' if value < SMALL else f'{value:.2f}'
    return f'{100.0 * value:.1f}'


def _table(title, names, rows, width=16):
    """Blocks of at most `width` columns, the words of each metric's name above each other."""
    blocks = [_block(title, names[start:start + width], rows) for start in range(0, len(names), width)]
    return '\n\n'.join(blocks)


def _block(title, names, rows):
    words = [name.split('_') for name in names]
    height = max(map(len, words))
    heads = [[''] * (height - len(parts)) + parts for parts in words]
    lines = [['' if level < height - 1 else title, *(head[level] for head in heads)] for level in range(height)]
    lines += [[method, *(_cell(name, row.get(name, math.nan)) for name in names)] for method, row in rows.items()]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return '\n'.join('  '.join([first.ljust(widths[0]), *map(str.rjust, others, widths[1:])])
                     for first, *others in lines)


def _version(package):
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return ''


def _processor():
    try:
        with open('/proc/cpuinfo') as file:
            name = next((line.split(':', 1)[1].strip() for line in file if line.startswith('model name')), '')
    except OSError:
        name = ''
    return name or platform.processor() or platform.machine()
