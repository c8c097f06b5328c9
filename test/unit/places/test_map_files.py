# SPDX-License-Identifier: Apache-2.0
"""Occupancy grids of other programs: what their files mean."""

import numpy as np
import pytest
from damage import damaged_bytes

from dbscan_reg_ros import SE2
from dbscan_reg_ros.places.map import MapError
from dbscan_reg_ros.places.map_files import load_grid
from dbscan_reg_ros.replays.occupancy_map import write_map
from dbscan_reg_ros.robot.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

VALUES = np.array([[FREE, FREE, OCCUPIED], [UNKNOWN, FREE, OCCUPIED]], dtype=np.int8)
"""Rows in the order of y."""
GREY = {FREE: 254, OCCUPIED: 0, UNKNOWN: 205}


def written(folder, header='P5\n3 2\n255\n', fields='', grey=GREY, image='map.pgm'):
    """A map of map_server in `folder`."""
    cells = np.vectorize(grey.get)(VALUES[::-1]).astype(np.uint8)
    (folder / image).write_bytes(header.encode() + cells.tobytes())
    lines = {'image': image, 'resolution': 0.1, 'origin': '[1.0, 2.0, 0.5]', 'negate': 0, 'occupied_thresh': 0.65,
             'free_thresh': 0.196} | dict(part.split(': ') for part in fields.split(', ') if part)
    (folder / 'map.yaml').write_text(''.join(f'{name}: {value}\n' for name, value in lines.items()))
    return folder / 'map.yaml'


def loaded(path):
    return load_grid(path).values[1:-1, 1:-1]


def test_cells_and_the_turned_origin_are_those_of_the_file(tmp_path):
    grid = load_grid(written(tmp_path))
    np.testing.assert_array_equal(grid.values[1:-1, 1:-1], VALUES)
    assert grid.resolution == pytest.approx(0.1) and grid.origin == SE2(1.0, 2.0, 0.5)
    assert grid.values.ravel()[grid.cells(grid.origin.apply([(0.25, 0.05)]))] == OCCUPIED


@pytest.mark.parametrize('header', ['P5 3 2 255\n', 'P5\n# CREATOR: map_saver 0.050 m/pix\n3 2\n255\n',
                                    'P5\n# one\n# two\n3\n# three\n2\n255\n'])
def test_headers_of_several_mappers_are_read(tmp_path, header):
    np.testing.assert_array_equal(loaded(written(tmp_path, header)), VALUES)


def test_a_negative_and_a_raw_picture_mean_the_same(tmp_path):
    negative = {FREE: 1, OCCUPIED: 255, UNKNOWN: 50}
    np.testing.assert_array_equal(loaded(written(tmp_path, fields='negate: 1', grey=negative)), VALUES)
    raw = {FREE: 0, OCCUPIED: 100, UNKNOWN: 255}
    np.testing.assert_array_equal(loaded(written(tmp_path, fields='mode: raw', grey=raw)), VALUES)


def test_our_own_grid_is_read_back(tmp_path):
    write_map(tmp_path, OccupancyGrid(VALUES, (-1.0, 3.0), 0.05))
    grid = load_grid(tmp_path / 'map.yaml')
    np.testing.assert_array_equal(grid.values[1:-1, 1:-1], VALUES)
    assert grid.origin == SE2(-1.0, 3.0, 0.0)


WRONG = {'image: none.pgm': 'none.pgm: No such file', 'mode: other': "mode is 'other'", 'origin: 3': 'no map',
         'resolution: 0': 'resolution is 0', 'resolution: fast': 'no map', 'negate: [': 'no map',
         'image: map.yaml': 'cannot be read: cannot identify'}


@pytest.mark.parametrize('fields', WRONG)
def test_a_wrong_file_is_refused_in_one_line(tmp_path, fields):
    path = written(tmp_path, fields=fields)
    with pytest.raises(MapError, match=r'map\.yaml') as raised:
        load_grid(path)
    assert WRONG[fields] in str(raised.value) and '\n' not in str(raised.value)


@pytest.mark.parametrize(('name', 'content', 'says'), [
    ('map.png', b'\x89PNG', 'expected a map of key frames (.npz'), ('drive.log', b'# CARMEN log', 'not its picture'),
    ('lds.yaml', b'/**: {ros__parameters: {scan.range_max: 8.0}}', 'it has no image and no resolution and no origin'),
    ('empty.yaml', b'', 'expected the .yaml of an occupancy grid'),
])
def test_a_file_of_another_kind_is_named_with_what_is_expected(tmp_path, name, content, says):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(MapError, match=f'{name}: no map') as raised:
        load_grid(tmp_path / name)
    assert says in str(raised.value) and '\n' not in str(raised.value)


def test_a_damaged_grid_is_read_or_refused_in_one_line(tmp_path):
    path = written(tmp_path)
    parts, rng = {each: each.read_bytes() for each in (path, tmp_path / 'map.pgm')}, np.random.default_rng(1)
    for number in range(60):
        for each, content in parts.items():
            each.write_bytes(damaged_bytes(content, rng) if number % 2 == (each is path) else content)
        try:
            load_grid(path)
        except MapError as error:
            assert str(path) in str(error) and '\n' not in str(error)
