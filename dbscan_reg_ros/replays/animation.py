# SPDX-License-Identifier: Apache-2.0
"""Moving picture of a drive: each scan on the growing map, as an animated GIF."""
import numpy as np

from ..core.geometry.se2 import SE2
from ..evaluation.metrics import path_lengths
from ..recordings.files import replacing

LONGER, MARGIN = 600, 24
"""Pixels of the map's longer side, and of the strip below it with the text."""
FRAMES, INTERVAL, LAST = 115, 100, 500
"""Number of pictures, and how long each and the last is shown [ms]: 12 s."""
PALETTE = ('#ffffff', '#c8ccd0', '#a9aeb4', '#8b9097', '#6c7178', '#50555b', '#0b5fa5', '#a3126a', '#16191d')
"""No return, then 1, 2, 4, 8 and 16 returns or more; the trajectory; the scan; the sensor and the text."""
MOST_SEEN, TRAJECTORY, SCAN, SENSOR = 5, 6, 7, 8
ARROW = np.array(((0.0, 0.0), (-1.0, 0.6), (-0.65, 0.0), (-1.0, -0.6))) * 14.0 + (6.0, 0.0)
"""Outline of the sensor [pixels], along its x axis."""


class Canvas:
    """Returns counted in the pixels of a map.

    Parameters
    ----------
    extent : (left, right, bottom, top) [m]
    """

    def __init__(self, extent):
        left, right, bottom, top = extent
        self._corner = np.array((left, top))
        self.scale = LONGER / max(right - left, top - bottom)
        width, height = max(round(self.scale * (right - left)), 1), max(round(self.scale * (top - bottom)), 1)
        self._counts = np.zeros((height, width), dtype=np.int64)

    def pixels(self, points):
        """Return points ``(..., 2)`` [m] in pixels, from the upper left corner."""
        return (points - self._corner) * (self.scale, -self.scale)

    def add(self, points):
        """Count the returns ``(P, 2)`` [m]."""
        columns, rows = self._inside(points).T
        np.add.at(self._counts, (rows, columns), 1)

    def picture(self, points, poses, text):
        """Return the map so far with the returns of the scan, the trajectory ``(N, 3)`` and a line of text."""
        from PIL import Image, ImageDraw, ImageFont

        levels = np.minimum(np.frexp(self._counts)[1], MOST_SEEN).astype(np.uint8)
        columns, rows = self._inside(points).T
        for down, right in ((0, 0), (0, 1), (1, 0), (1, 1)):
            levels[np.minimum(rows + down, len(levels) - 1), np.minimum(columns + right, levels.shape[1] - 1)] = SCAN
        image = Image.new('P', (max(levels.shape[1], 240), levels.shape[0] + MARGIN))
        image.putpalette(bytes.fromhex(''.join(colour[1:] for colour in PALETTE)))
        image.paste(Image.fromarray(levels), (0, 0))
        draw = ImageDraw.Draw(image)
        draw.line([tuple(place) for place in self.pixels(poses[:, :2]).tolist()], fill=TRAJECTORY, width=2)
        outline = SE2(theta=-poses[-1, 2]).apply(ARROW * (1.0, -1.0)) + self.pixels(poses[-1, :2])
        draw.polygon([tuple(place) for place in outline.tolist()], fill=SENSOR)
        draw.text((6, levels.shape[0] + 4), text, fill=SENSOR, font=ImageFont.load_default(13))
        return image

    def _inside(self, points):
        """Return column and row ``(P, 2)`` of the points on the map."""
        places = np.floor(self.pixels(points)).astype(int)
        return places[((places >= 0) & (places < self._counts.shape[::-1])).all(axis=1)]


def write_animation(path, scans, poses, stamps, extent):
    """Write the moving picture of a drive.

    Parameters
    ----------
    path : Path
        Of the GIF.
    scans : iterable of Scan
        One for each pose; taken one at a time.
    poses : (N, 3) float [m, m, rad]
        Of the sensor.
    stamps : sequence of int (N,) [ns]
    extent : (left, right, bottom, top) [m]
        Of the map.
    """
    canvas, distance, frames = Canvas(extent), path_lengths(poses), []
    shown = set(np.linspace(0, len(poses) - 1, min(FRAMES, len(poses))).astype(int).tolist())
    for number, (scan, pose) in enumerate(zip(scans, poses, strict=False)):
        points = SE2.from_array(pose).apply(scan.points[scan.valid])
        canvas.add(points)
        if number in shown:
            text = f'scan {number}, {(stamps[number] - stamps[0]) * 1e-9:.0f} s, {distance[number]:.0f} m'
            frames.append(canvas.picture(points, poses[:number + 1], text))
    with replacing(path, binary=True) as file:
        frames[0].save(file, format='GIF', save_all=True, append_images=frames[1:], loop=0,
                       duration=[INTERVAL] * (len(frames) - 1) + [LAST])
