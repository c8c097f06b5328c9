# SPDX-License-Identifier: Apache-2.0
"""The moving picture of a drive: its frames, their time and what is drawn."""
import numpy as np
import pytest
from PIL import Image

from dbscan_reg_ros.figures.plots import density_map
from dbscan_reg_ros.replays.animation import FRAMES, PALETTE, write_animation


def colour(image, index):
    """Pixels ``(rows, columns)`` that have a colour of the palette."""
    wanted = np.array(list(bytes.fromhex(PALETTE[index][1:])))
    return (np.asarray(image.convert('RGB')) == wanted).all(axis=2)


@pytest.mark.parametrize('count', [2, 80])
def test_each_frame_shows_the_map_so_far_the_scan_and_the_sensor(scans, truth, tmp_path, count):
    poses = np.array([pose.as_array() for pose in truth[:count]])
    extent = density_map(scans[:count], poses).extent
    path = tmp_path / 'a.gif'
    write_animation(path, scans[:count], poses, [scan.stamp for scan in scans[:count]], extent)
    with Image.open(path) as image:
        assert image.n_frames == min(count, FRAMES)
        time, seen = 0, []
        scale = 600 / max(extent[1] - extent[0], extent[3] - extent[2])
        for number in range(image.n_frames):
            image.seek(number)
            time += image.info['duration']
            seen.append(sum(colour(image, level).sum() for level in range(1, 6)))
            rows, columns = np.nonzero(colour(image, 8)[:-24])
            middle = (poses[number, :2] - (extent[0], extent[3])) * (scale, -scale)
            assert np.hypot(columns.mean() - middle[0], rows.mean() - middle[1]) < 15.0
            assert colour(image, 7).sum() > 100
        assert time == 100 * (image.n_frames - 1) + 500
        assert seen[-1] > seen[0]


def test_a_long_drive_takes_twelve_seconds(scans, truth, tmp_path):
    poses = np.array([pose.as_array() for pose in truth] * 5)
    extent = density_map(scans, poses[:len(scans)]).extent
    write_animation(tmp_path / 'a.gif', scans * 5, poses, list(range(len(poses))), extent)
    with Image.open(tmp_path / 'a.gif') as image:
        durations = []
        for number in range(image.n_frames):
            image.seek(number)
            durations.append(image.info['duration'])
    assert sum(durations) <= 12_000
