# SPDX-License-Identifier: Apache-2.0
"""Moving picture of a drive: each scan on the growing map, then the closed map."""
import io
import shutil
import subprocess
from typing import NamedTuple

import numpy as np

from ..core.geometry.se2 import SE2
from ..evaluation.metrics import path_lengths
from ..figures.plots import DensityMap
from ..recordings.files import replacing

LONGER, MARGIN = 600, 24
"""Pixels of the longer side of the map, and height of the text strip below the map in pixels."""
FRAMES, INTERVAL, LAST, CLOSED = 90, 100, 500, 2000
"""Number of frames; display time [ms] of a frame, of the last frame and of the map after loop closing; total 11.4 s."""
PALETTE = ('#ffffff', '#c8ccd0', '#a9aeb4', '#8b9097', '#6c7178', '#50555b', '#0b5fa5', '#a3126a', '#16191d')
"""Colours: no return, then 1, 2, 4, 8 and 16 returns or more; the trajectory; the scan; the sensor and the text."""
MOST_SEEN, TRAJECTORY, SCAN, SENSOR = 5, 6, 7, 8
ARROW = np.array(((0.0, 0.0), (-1.0, 0.6), (-0.65, 0.0), (-1.0, -0.6))) * 14.0 + (6.0, 0.0)
"""Outline of the sensor [pixels], along its x axis."""


class Track(NamedTuple):
    """Estimated poses of a drive, and the map drawn from them."""

    poses: np.ndarray
    """Poses of the sensor ``(N, 3)`` [m, m, rad]."""
    stamps: list
    """sequence of int (N,) [ns]"""
    density: DensityMap


class Canvas:
    """Map of an `extent` (left, right, bottom, top) [m] that counts the returns in each of its pixels."""

    def __init__(self, extent):
        left, right, bottom, top = extent
        self._corner = np.array((left, top))
        self.scale = LONGER / max(right - left, top - bottom)
        width, height = max(round(self.scale * (right - left)), 1), max(round(self.scale * (top - bottom)), 1)
        self._counts = np.zeros((height, width), dtype=np.int64)

    def pixels(self, points):
        """Convert points ``(..., 2)`` [m] to pixel coordinates, counted from the upper left corner."""
        return (points - self._corner) * (self.scale, -self.scale)

    def add(self, points):
        """Add returns ``(P, 2)`` [m] to the counts of the pixels."""
        columns, rows = self._inside(points).T
        np.add.at(self._counts, (rows, columns), 1)

    def picture(self, points, poses, text):
        """Return a picture of the current map, the returns of a scan, the trajectory ``(N, 3)`` and a line of text."""
        levels = np.minimum(np.frexp(self._counts)[1], MOST_SEEN).astype(np.uint8)
        columns, rows = self._inside(points).T
        for down, right in ((0, 0), (0, 1), (1, 0), (1, 1)):
            levels[np.minimum(rows + down, len(levels) - 1), np.minimum(columns + right, levels.shape[1] - 1)] = SCAN
        return self._drawn(levels, poses, text)

    def closed_picture(self, closed):
        """Return a picture of the map of a `Track` after loop closing."""
        ink, (left, right, bottom, _) = closed.density
        cell = (right - left) / ink.shape[1]
        rows, columns = np.nonzero(ink)
        centres = (np.column_stack((columns, rows)) + 0.5) * cell + (left, bottom)
        places = np.floor(self.pixels(centres)).astype(int)
        levels = np.zeros(self._counts.shape, dtype=np.uint8)
        places = np.minimum(places, np.array(levels.shape[::-1]) - 1)
        np.maximum.at(levels, tuple(places.T[::-1]), np.ceil(MOST_SEEN * ink[rows, columns]).astype(np.uint8))
        return self._drawn(levels, closed.poses, 'after loop closing')

    def _drawn(self, levels, poses, text):
        """Return a picture from a map of colour numbers, the trajectory ``(N, 3)`` and a line of text."""
        from PIL import Image, ImageDraw, ImageFont

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
        """Return column and row ``(P, 2)`` of the points that lie on the map."""
        places = np.floor(self.pixels(points)).astype(int)
        return places[((places >= 0) & (places < self._counts.shape[::-1])).all(axis=1)]


def write_animation(path, scans, track, closed=None):
    """Write the moving picture of a drive as GIF and, if ffmpeg is found, as MP4; write its last frame as PNG.

    `path` is that of the GIF; PNG and MP4 have another ending. The `scans`, one for each pose of the `track`, are read
    one at a time. `closed` is the drive after loop closing, whose map becomes the first and the last frame.
    """
    extents = np.array([each.density.extent for each in (track, closed) if each])
    canvas = Canvas((extents[:, 0].min(), extents[:, 1].max(), extents[:, 2].min(), extents[:, 3].max()))
    frames = list(_frames(canvas, scans, track))
    times = [INTERVAL] * (len(frames) - 1) + [LAST]
    if closed:
        # It comes first as well: that is what is visible where pictures do not move.
        picture = canvas.closed_picture(closed)
        frames, times = [picture, *frames, picture], [LAST, *times, CLOSED]
    with replacing(path, binary=True) as file:
        frames[0].save(file, format='GIF', save_all=True, append_images=frames[1:], loop=0, duration=times)
    with replacing(path.with_suffix('.png'), binary=True) as file:
        frames[-1].save(file, format='PNG', optimize=True)
    if program := shutil.which('ffmpeg'):
        _write_mp4(program, path.with_suffix('.mp4'), frames, times)


def _frames(canvas, scans, track):
    """Yield the frames that show the odometry before loop closing."""
    poses, stamps, distance = track.poses, track.stamps, path_lengths(track.poses)
    shown = set(np.linspace(0, len(poses) - 1, min(FRAMES, len(poses))).astype(int).tolist())
    for number, (scan, pose) in enumerate(zip(scans, poses, strict=False)):
        points = SE2.from_array(pose).apply(scan.points[scan.valid])
        canvas.add(points)
        if number in shown:
            text = f'odometry: scan {number}, {(stamps[number] - stamps[0]) * 1e-9:.0f} s, {distance[number]:.0f} m'
            yield canvas.picture(points, poses[:number + 1], text)


def _write_mp4(program, path, frames, times):
    """Write the frames as MP4 with the ffmpeg program at `program`; each is shown for its time in `times` [ms]."""
    stream = io.BytesIO()
    for frame, time in zip(frames, times, strict=True):
        for _ in range(time // INTERVAL):
            frame.save(stream, format='PNG')
    # Most players need even sides and this pixel format.
    subprocess.run([program, '-loglevel', 'error', '-y', '-f', 'image2pipe', '-framerate', str(1000 // INTERVAL),
                    '-i', '-', '-vf', 'pad=ceil(iw/2)*2:ceil(ih/2)*2', '-pix_fmt', 'yuv420p', str(path)],
                   input=stream.getvalue(), check=True)
