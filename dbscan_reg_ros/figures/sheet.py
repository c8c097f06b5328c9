# SPDX-License-Identifier: Apache-2.0
"""The figures of a pair: one picture each, and one sheet with all of them."""
from collections.abc import Callable
from typing import NamedTuple

from .clusters import draw_rotation, draw_translation, explain_translation
from .densities import draw_densities
from .overlay import draw_overlay, explain_overlay
from .plots import picture, save, write_png
from .scans import draw_points, draw_scan_segments


class Drawing(NamedTuple):
    """One figure of a pair of scans."""

    title: str
    draw: Callable
    """``draw(figure, steps)``."""
    caption: Callable
    """``caption(steps)`` is the text that explains what the figure should show."""


FIGURES = {
    'points': Drawing(
        'Points before and after the ring band filter', draw_points, lambda _:
        'Crosses mark removed points, if any: usually single returns between surfaces.\n'
        'Walls and corners should be kept.'),
    'segments': Drawing(
        'Segments, breakpoints and ends', draw_scan_segments, lambda _:
        'Each straight wall should be one segment, up to a corner, a free end, or where another object hides it.\n'
        'Behind a free end the next return is farther; behind another end it is nearer, as far, or missing. '
        'Every fifth segment has its number, from 0.'),
    'rotation': Drawing(
        'Rotation: clusters of angle differences', draw_rotation, lambda _:
        'Near the true rotation the angle differences of many segments usually agree and form a cluster over several '
        'rows.\nThe rows are numbered as in the picture of the segments. A wide search, if it '
        'followed, is not drawn.'),
    'translation': Drawing(
        'Translation: clusters of the samples', draw_translation, explain_translation),
    'densities': Drawing(
        'Densities of the coordinates', draw_densities, lambda _:
        'Figures 9 to 12 of the paper. Only the method of the paper selects by this sum; points that only one scan '
        'sees raise it at the true motion, too.'),
    'overlay': Drawing(
        'Overlay of the scans', draw_overlay, explain_overlay),
}
"""Name of each figure, without ending -> `Drawing`."""
SIZE = 12.0, 7.0
"""Size of a picture [inch]."""
SMALLEST_FONT = 6.0
"""[pt]"""
DPI = 100
LAYOUT = [['overlay', 'overlay', 'points'], ['overlay', 'overlay', 'segments'],
          ['rotation', 'translation', 'densities']]
"""Position of each figure on the sheet; one with several places is enlarged."""


def draw_figures(folder, steps, title, size=SIZE, ending='png'):
    """Write a picture for each of the `FIGURES` of `Steps` into `folder`, and ``sheet.png`` with all of them.

    Each picture has the `size` [inch]. With the `ending` ``pdf`` or ``svg`` they are for papers: without titles,
    captions and the sheet.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure
    from PIL import Image

    width, height = (round(DPI * side) for side in size)
    sheet = Image.new('RGB', (len(LAYOUT[0]) * width, len(LAYOUT) * height))
    for name, drawing in FIGURES.items():
        figure = Figure(figsize=size, layout='constrained')
        if ending != 'png':
            with rc_context({'font.size': min(max(10.0 * size[0] / SIZE[0], SMALLEST_FONT), 10.0)}):
                drawing.draw(figure, steps)
                save(figure, folder / f'{name}.{ending}', DPI)
            continue
        drawing.draw(figure, steps)
        figure.suptitle(f'{title}\n{drawing.title}')
        figure.supxlabel(drawing.caption(steps), fontsize='medium')
        image = picture(figure, DPI)
        write_png(folder / f'{name}.png', image)
        places = [(column, row) for row, names in enumerate(LAYOUT) for column, each in enumerate(names)
                  if each == name]
        (left, top), (right, _) = places[0], places[-1]
        enlarged = right - left + 1
        sheet.paste(image if enlarged == 1 else picture(figure, enlarged * DPI), (left * width, top * height))
    if ending == 'png':
        write_png(folder / 'sheet.png', sheet)
