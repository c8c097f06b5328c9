# SPDX-License-Identifier: Apache-2.0
"""Maps of key frames: what is kept, written and read."""
import io
import json
import math
import zipfile

import numpy as np
import pytest
from damage import damaged_bytes
from scipy.optimize import least_squares

from dbscan_reg_ros import SE2, Odometry, Parameters
from dbscan_reg_ros.core.geometry.se2 import wrap
from dbscan_reg_ros.places.map import COMMON, SPACING, Map, MapError
from dbscan_reg_ros.places.mapper import Mapper, Relation, mean_motion
from dbscan_reg_ros.places.pose_graph import Constraints, PoseGraph, optimise, relative_covariance, write_g2o
from dbscan_reg_ros.recordings.poses import relative
from dbscan_reg_ros.simulation import Lidar, follow, hall, simulate


def driven(lidar):
    """The mapper of a drive there and back through a hall, and the poses (K, 3) of the key frames of the odometry."""
    drive = simulate(hall(seed=1), follow([(2.0, 2.2), (14.0, 2.2), (2.0, 2.2)], speed=1.0), lidar, seed=1)
    odometry, mapper, poses = Odometry(), Mapper(), []
    for scan in drive.scans:
        update = odometry.process(scan)
        found = mapper.process(update)
        if update.is_key_frame:
            poses.append(found.pose.as_array())
    return mapper, np.array(poses)


@pytest.fixture(scope='module')
def half_turn():
    return driven(Lidar(rate=2.0))


@pytest.fixture(scope='module')
def whole_turn():
    return driven(Lidar(beams=360, angle_min=-math.pi, rate=2.0))


@pytest.fixture
def saved(whole_turn, tmp_path):
    path = tmp_path / 'map.npz'
    made = whole_turn[0].map(SE2(0.1, -0.2, 0.0))
    made.save(path)
    return path, made


def test_what_is_read_is_what_was_written(saved):
    path, made = saved
    read = Map.load(path)
    for one, other in ((read.graph.poses, made.graph.poses),
                       *zip(read.graph.constraints, made.graph.constraints, strict=True)):
        np.testing.assert_array_equal(one, other)
    assert read.mounting == SE2(0.1, -0.2, 0.0) and len(made.graph.constraints.loops.pairs)
    for one, other in zip(read.views, made.views, strict=True):
        assert (one.frame, one.noise_ratio, one.scan.geometry) == (other.frame, other.noise_ratio, other.scan.geometry)
        assert one.features(Parameters()).points.tobytes() == other.features(Parameters()).points.tobytes()
    assert [each.name for each in path.parent.iterdir()] == ['map.npz']


def test_a_place_has_a_view_for_each_heading_that_shows_another_part(half_turn, whole_turn):
    """Both directions of the drive for half a turn; one direction for a whole turn."""
    mapper, seen = half_turn
    poses = mapper.map().poses
    assert len(poses) < len(seen)
    facing = np.abs(wrap(seen[:, None, 2] - poses[None, :, 2])) <= (1.0 - COMMON) * math.pi + 0.01
    near = np.hypot(*(seen[:, None] - poses)[..., :2].transpose(2, 0, 1)) <= SPACING + 0.01
    assert (facing & near).any(axis=1).all()
    assert len(whole_turn[0].map().views) < 0.7 * len(poses)


def member(path, name, content):
    """Replace an array of the archive."""
    with zipfile.ZipFile(path) as archive:
        parts = {each: archive.read(each) for each in archive.namelist()}
    buffer = io.BytesIO()
    np.save(buffer, content)
    with zipfile.ZipFile(path, 'w') as archive:
        for each, old in parts.items():
            archive.writestr(each, buffer.getvalue() if each == f'{name}.npy' else old)


WRONG = {'poses': np.zeros((3, 2)), 'pairs': np.array([[0, 10**6]]), 'frames': np.zeros(1, dtype=int),
         'covariances': -np.ones((1, 3, 3)), 'motions': np.full((5, 3), np.nan), 'twists': np.array(['a']),
         'map': np.frombuffer(json.dumps({'format': 'dbscan_reg_ros map', 'version': 2}).encode(), dtype=np.uint8)}


@pytest.mark.parametrize('name', WRONG)
def test_a_map_whose_parts_do_not_fit_together_is_refused_in_one_line(saved, name):
    path, _ = saved
    member(path, name, WRONG[name])
    with pytest.raises(MapError, match=r'map\.npz') as raised:
        Map.load(path)
    assert '\n' not in str(raised.value)


@pytest.mark.filterwarnings('error')
def test_a_damaged_file_is_read_or_refused_in_one_line(saved):
    path, made = saved
    content, rng, refused = path.read_bytes(), np.random.default_rng(1), 0
    for _ in range(60):
        path.write_bytes(damaged_bytes(content, rng, made.poses.tobytes()))
        try:
            Map.load(path)
        except MapError as error:
            assert str(path) in str(error) and '\n' not in str(error)
            refused += 1
    assert refused > 40


def test_a_map_that_cannot_be_written_leaves_the_old_one(saved, monkeypatch):
    path, made = saved
    content = path.read_bytes()
    monkeypatch.setattr(np, 'savez_compressed', lambda file, **_: file.write(b'x') and 1 / 0)
    with pytest.raises(ZeroDivisionError):
        made.save(path)
    assert path.read_bytes() == content and [each.name for each in path.parent.iterdir()] == ['map.npz']


def read_g2o(path):
    """Read vertices and edges; the information is symmetric, upper triangle row by row."""
    vertices, edges = {}, []
    for line in path.read_text().splitlines():
        kind, *words = line.split()
        if kind == 'VERTEX_SE2':
            vertices[int(words[0])] = [float(word) for word in words[1:]]
        elif kind == 'EDGE_SE2':
            xx, xy, xt, yy, yt, tt = map(float, words[5:])
            edges.append((int(words[0]), int(words[1]), np.array([float(word) for word in words[2:5]]),
                          np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])))
        else:
            assert line == 'FIX 0'
    return np.array([vertices[number] for number in sorted(vertices)]), edges


def test_another_solver_finds_the_same_poses_in_the_g2o_file(half_turn, tmp_path):
    """With the error of g2o, the difference of the components of the motion, and without a robust kernel."""
    poses, constraints = half_turn[0].graph
    kept = constraints.pairs.max(axis=1) < 12
    path = tmp_path / 'graph.g2o'
    few = type(constraints)(*(part[kept] for part in constraints))
    moved = few.motions + np.random.default_rng(1).normal(0.0, 0.01, few.motions.shape)
    few = few._replace(pairs=np.vstack((few.pairs, (0, 11))), motions=np.vstack((moved, relative(
        poses[:1], poses[11:12]))), covariances=np.concatenate((few.covariances, 1e-4 * np.eye(3)[None])))
    write_g2o(path, PoseGraph(poses[:12], few))
    vertices, edges = read_g2o(path)
    np.testing.assert_array_equal(vertices, poses[:12])

    def residuals(free):
        now = np.vstack((vertices[:1], free.reshape(-1, 3)))
        found = []
        for first, second, motion, information in edges:
            off = relative(now[first:first + 1], now[second:second + 1])[0] - motion
            off[2] = wrap(off[2])
            found.append(np.linalg.cholesky(information).T @ off)
        return np.concatenate(found)

    best = least_squares(residuals, vertices[1:].ravel(), loss='linear', x_scale='jac').x.reshape(-1, 3)
    unweighted = few._replace(covariances=few.covariances * 1e6)  # far within the robust kernel
    assert optimise(poses[:12], unweighted)[1:] == pytest.approx(best, abs=1e-5)


def test_the_covariance_between_two_poses_is_that_of_all_ways_between_them():
    """Directly, over a third pose, and not by way of a fourth, which hangs on one constraint."""
    steps = SE2(1.0, 0.3, 0.4), SE2(0.5, -0.8, 1.1), SE2(0.2, 0.0, -0.5)
    poses = [SE2(0.3, 0.1, 2.0)]
    for step in steps:
        poses.append(poses[-1] @ step)
    root = np.random.default_rng(1).normal(0.0, 0.02, (4, 3, 3))
    covariances = root @ root.transpose(0, 2, 1) + 1e-5 * np.eye(3)
    pairs = np.array([(0, 1), (1, 2), (2, 3), (0, 2)])
    motions = [(poses[first].inverse() @ poses[second]).as_array() for first, second in pairs]
    graph = PoseGraph(np.array([pose.as_array() for pose in poses]), Constraints(pairs, np.array(motions), covariances))
    over = Relation(0, steps[0], covariances[0]).then(steps[1], covariances[1])
    expected = mean_motion(over, Relation(0, over.motion, covariances[3])).covariance
    assert relative_covariance(graph, 0, 2) == pytest.approx(expected, rel=1e-3, abs=1e-9)
    back = over.motion.adjoint()
    assert relative_covariance(graph, 2, 0) == pytest.approx(back @ expected @ back.T, rel=1e-3, abs=1e-9)
    assert not relative_covariance(graph, 1, 1).any()
