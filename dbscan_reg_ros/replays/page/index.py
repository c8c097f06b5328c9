# SPDX-License-Identifier: Apache-2.0
"""Index of several drives: a table of all drives, and for each drive a small map with a link to its page."""
from collections.abc import Sequence
from html import escape
from typing import NamedTuple
from urllib.parse import quote

import numpy as np

from ...evaluation.metrics import without_holes
from ...recordings.files import replacing
from .encoding import picture
from .report import page_parts

CELLS = 300
"""Number of cells along the longer side of a small map."""
MOST_POSES = 400
DASHES = {'truth': '7 4', 'other0': '12 4', 'other1': '3 3', 'other2': '12 3 3 3', 'other3': '5 2',
          'other4': '1 5'}
"""Kind of trajectory -> dash pattern of its line, the same as on the page of a drive."""


class SmallMap(NamedTuple):
    """Small map of a drive in the index."""

    image: str
    """Picture of the map as a data URL."""
    extent: tuple
    """(left, right, bottom, top) [m]"""
    lines: list
    """list of (str, str, list of (N, 2) float [m]): kind and name of each trajectory, and the positions of its parts,
    which end where positions are unknown."""


class DriveEntry(NamedTuple):
    """Entry of a drive in the index."""

    name: str
    link: str
    """Address of the page of the drive, relative to the index; empty without a page."""
    rows: list
    """list of list of str: table rows of the drive."""
    map: SmallMap
    notes: Sequence[str] = ()
    """Sentences shown below the map."""


def small_map(density, lines) -> SmallMap:
    """Return the map for the index from a `DensityMap` and lines of (kind, name, positions ``(N, 2)``)."""
    ink = density.ink
    step = -(-max(ink.shape) // CELLS)
    rows, columns = (-(-size // step) * step for size in ink.shape)
    padded = np.zeros((rows, columns))
    padded[:ink.shape[0], :ink.shape[1]] = ink
    left, _, bottom, _ = density.extent
    cell = (density.extent[1] - left) / ink.shape[1]
    largest = padded.reshape(rows // step, step, columns // step, step).max(axis=(1, 3))
    thinned = [(kind, name, _thinned(at)) for kind, name, at in lines]
    return SmallMap(picture(largest), (left, left + columns * cell, bottom, bottom + rows * cell), thinned)


def _thinned(positions):
    """Return the parts of a line between the holes of its `positions` ``(N, 2)``, `MOST_POSES` of them in all."""
    step = -(-len(positions) // MOST_POSES) or 1
    return [positions[rows[::step]] for rows in without_holes(np.isfinite(positions).all(axis=1))]


class Columns(NamedTuple):
    """Columns of the table of an index."""

    names: list[str]
    """Headings, beginning with that of the row headings."""
    terms: str
    """Sentences that explain the columns."""


def write_index(path, title, columns, entries):
    """Write the index of several drives as an HTML page.

    If the first column is called ``recording``, each drive has one row; else a row with its name precedes its rows.
    """
    head = ''.join(f'<th scope="col">{escape(column)}</th>' for column in columns.names)
    single = columns.names[0] == 'recording'
    rows = _drive_row if single else _drive_rows
    contents = {'title': escape(title), 'kind': 'drives' if single else 'rows',
                'drives': ''.join(map(_drive, entries)), 'terms': escape(columns.terms),
                'table': f'<thead><tr>{head}</tr></thead>{"".join(map(rows, entries))}'}
    with replacing(path) as file:
        for part in page_parts(contents, 'index.html'):
            file.write(part)


def _drive_row(entry):
    """Return the table row of a drive, with its name as heading."""
    return f'<tbody><tr><th scope="row">{_linked(entry)}</th>{_cells(entry.rows[0])}</tr></tbody>'


def _drive_rows(entry):
    """Return the table rows of a drive below a row with its name; the first cell of each row is its heading."""
    rows = ''.join(f'<tr><th scope="row">{escape(first)}</th>{_cells(rest)}</tr>' for first, *rest in entry.rows)
    return (f'<tbody><tr><th scope="rowgroup" colspan="{len(entry.rows[0])}">{_linked(entry)}</th></tr>'
            f'{rows}</tbody>')


def _linked(entry):
    return f'<a href="{escape(quote(entry.link))}">{escape(entry.name)}</a>' if entry.link else escape(entry.name)


def _cells(row):
    return ''.join(f'<td>{escape(value)}</td>' for value in row)


def _drive(entry):
    """Return the list item of a drive: its map, trajectories and their legend."""
    left, right, bottom, top = entry.map.extent
    lines = ''.join(f'<polyline points="{_points(at)}" style="{_stroke(kind)}"/>'
                    for kind, _, parts in entry.map.lines for at in parts)
    legend = ''.join(f'<li><svg class="key" viewBox="0 0 30 14" style="width: 30px; height: 14px" aria-hidden="true">'
                     f'<polyline points="0,7 30,7" style="{_stroke(kind)}"/></svg>{escape(name)}</li>'
                     for kind, name, _ in entry.map.lines)
    notes = ''.join(f'<p>{escape(note)}</p>' for note in entry.notes)
    return (f'<li><h3>{_linked(entry)}</h3><svg role="img" aria-label="map of {escape(entry.name)}" '
            f'viewBox="{left:.3f} {-top:.3f} {right - left:.3f} {top - bottom:.3f}">'
            f'<image href="{entry.map.image}" x="{left:.3f}" y="{-top:.3f}" width="{right - left:.3f}" '
            f'height="{top - bottom:.3f}" preserveAspectRatio="none"/>{lines}</svg>'
            f'<ul class="legend">{legend}</ul>{notes}</li>')


def _points(positions):
    return ' '.join(f'{x:.2f},{-y:.2f}' for x, y in positions.tolist())


def _stroke(kind):
    """Return the line style of a trajectory; competitors differ in colour and in dash pattern."""
    return f'stroke: var(--{kind}); stroke-dasharray: {DASHES.get(kind, "none")}'
