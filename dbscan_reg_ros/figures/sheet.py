# SPDX-License-Identifier: Apache-2.0
"""The figures of a pair: one picture each, and one sheet with all of them."""
from .clusters import draw_rotation, draw_translation
from .densities import draw_densities
from .overlay import draw_overlay
from .plots import save
from .scans import draw_points, draw_scan_segments

FIGURES = {
    'points': ('Points before and after the ring band filter', draw_points),
    'segments': ('Segments, breakpoints and ends', draw_scan_segments),
    'rotation': ('Rotation: clusters of angle differences', draw_rotation),
    'translation': ('Translation: clusters of the samples of lines and end points', draw_translation),
    'densities': ('Densities of the coordinates', draw_densities),
    'overlay': ('Overlay of the scans', draw_overlay),
}
"""Name -> title, and ``draw(figure, steps)``."""
SIZE = 12.0, 7.0
"""[inch]"""
DPI = 100
COLUMNS = 2


def draw_figures(folder, steps, title):
    """Write ``NAME.png`` for each of the `FIGURES` of `Steps`, and ``sheet.png``, into `folder`."""
    from matplotlib.figure import Figure

    for name, (about, draw) in FIGURES.items():
        figure = Figure(figsize=SIZE, layout='constrained')
        draw(figure, steps)
        figure.suptitle(f'{title}\n{about}')
        save(figure, folder / f'{name}.png', DPI)
    rows = -(-len(FIGURES) // COLUMNS)
    sheet = Figure(figsize=(COLUMNS * SIZE[0], rows * SIZE[1] + 0.5), layout='constrained')
    sheet.suptitle(title, fontsize='xx-large')
    for part, (about, draw) in zip(sheet.subfigures(rows, COLUMNS).flat, FIGURES.values()):
        draw(part, steps)
        part.suptitle(about, fontsize='x-large')
    save(sheet, folder / 'sheet.png', DPI)
