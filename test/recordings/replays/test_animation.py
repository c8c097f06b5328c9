# SPDX-License-Identifier: Apache-2.0
"""The moving picture of a drive: its frames, their time and what is drawn."""
import shutil

import numpy as np
import pytest
from PIL import Image

from dbscan_reg_ros.figures.plots import density_map
from dbscan_reg_ros.replays.animation import FRAMES, PALETTE, Track, write_animation


def colour(image, index):
    """Pixels ``(rows, columns)`` of an RGB image that have a colour of the palette."""
    wanted = np.array(list(bytes.fromhex(PALETTE[index][1:])), dtype=np.uint8)
    return (np.asarray(image) == wanted).all(axis=2)


def test_each_frame_shows_the_map_so_far_the_scan_and_the_sensor(scans, truth, tmp_path):
    count = 20
    poses = np.array([pose.as_array() for pose in truth[:count]])
    density = density_map(scans[:count], poses)
    extent = density.extent
    path = tmp_path / 'a.gif'
    write_animation(path, scans[:count], Track(poses, [scan.stamp for scan in scans[:count]], density))
    with Image.open(path) as image:
        assert image.n_frames == min(count, FRAMES)
        time, seen = 0, []
        scale = 600 / max(extent[1] - extent[0], extent[3] - extent[2])
        for number in range(image.n_frames):
            image.seek(number)
            time += image.info['duration']
            frame = image.convert('RGB')
            seen.append(sum(colour(frame, level).sum() for level in range(1, 6)))
            rows, columns = np.nonzero(colour(frame, 8)[:-24])
            middle = (poses[number, :2] - (extent[0], extent[3])) * (scale, -scale)
            assert np.hypot(columns.mean() - middle[0], rows.mean() - middle[1]) < 15.0
            assert colour(frame, 7).sum() > 100
        assert time == 100 * (image.n_frames - 1) + 500
        assert seen[-1] > seen[0]


@pytest.mark.long
def test_a_long_drive_takes_twelve_seconds(scans, truth, tmp_path):
    poses = np.array([pose.as_array() for pose in truth] * 5)
    density = density_map(scans, poses[:len(scans)])
    track = Track(poses, list(range(len(poses))), density)
    moved = poses + np.array((2.0, 0.0, 0.0))
    closed = Track(moved, track.stamps, density_map(scans, moved[:len(scans)]))
    write_animation(tmp_path / 'a.gif', scans * 5, track, closed)
    with Image.open(tmp_path / 'a.gif') as image:
        durations, pictures = [], []
        for number in range(image.n_frames):
            image.seek(number)
            durations.append(image.info['duration'])
            pictures.append(image.convert('RGB'))
    assert 11_000 <= sum(durations) <= 12_000
    still = Image.open(tmp_path / 'a.png').convert('RGB')
    np.testing.assert_array_equal(still, pictures[-1])
    scale = 600 / (np.ptp([density.extent[:2], closed.density.extent[:2]]))
    before, after = (np.nonzero(colour(picture, 8)[:-24])[1].mean() for picture in pictures[-2:])
    assert after - before == pytest.approx(2.0 * scale, abs=2.0)
    walls = sum(colour(still, level)[:-24] for level in range(1, 6)).sum()
    assert walls > 0.5 * sum(colour(pictures[-2], level)[:-24] for level in range(1, 6)).sum()


@pytest.mark.skipif(shutil.which('ffmpeg') is None, reason='needs ffmpeg')
def test_where_ffmpeg_is_found_there_is_an_mp4(scans, truth, tmp_path):
    poses = np.array([pose.as_array() for pose in truth[:20]])
    track = Track(poses, list(range(20)), density_map(scans[:20], poses))
    write_animation(tmp_path / 'a.gif', scans[:20], track)
    assert (tmp_path / 'a.mp4').read_bytes()[4:8] == b'ftyp'
