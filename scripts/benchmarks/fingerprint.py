# SPDX-License-Identifier: Apache-2.0
"""Comparison of two commits, bit for bit: both source trees process the same scans on the same machine.

A change that should change nothing must not change a bit.
"""
import dataclasses
import hashlib
import itertools
import math
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dbscan_reg_ros.core.errors import DbscanRegError
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.scan_geometry import ScanGeometry
from dbscan_reg_ros.evaluation.methods import BenchmarkError
from dbscan_reg_ros.evaluation.trackers import SPREAD
from dbscan_reg_ros.recordings import data_folder, open_recording
from dbscan_reg_ros.recordings.message_fields import header_fields, pose_fields
from dbscan_reg_ros.recordings.playback import TRANSFORMS, Channel, Played
from dbscan_reg_ros.recordings.poses import relative
from dbscan_reg_ros.simulation import LIDARS, follow, rooms
from dbscan_reg_ros.simulation import measure as seen

from .intel import Intel
from .node.running_node import PATIENCE, graph, numbers_of, running_node
from .odometry.courses import COURSES
from .report import Report, machine
from .trees import built, default_cache, environment, resolved, root

RECORDER = Path(__file__).with_name('recorder.py')
"""A script of its own: it runs with the package of the other commit."""
RECORDINGS = {'intel': 'intel/intel.log.gz', 'aces': 'aces/aces.log.gz', 'urg04lx': 'urg04lx/exp1',
              'lms511': 'lms511/static', 'ccny_demo': 'ccny_demo/demo.bag'}
SIMULATED = ('rooms', 'corridors', 'halls', 'featureless', 'round', 'chairs', 'trees', 'lidars', 'leader', 'far_noise',
             'losses', 'bursts', 'outages', 'sparse', 'narrow', 'passers', 'covered', 'spin', 'spinup')
PLACE = SE2(0.3, -0.2, math.radians(135.0))
MOUNTED = ('mounted', 'upside_down', 'moving')
SWAY, SWAY_PERIOD = (0.1, 0.05, math.radians(30.0)), 7.0
"""Largest way of a moving laser from its place [m, m, rad], and how long it takes to come back [s]."""
MOUNTED_SCANS = PAIRS = 300
WHEELS = 'intel_wheels'
NODE = tuple(f'node_{name}' for name in MOUNTED)
GROUPS = (*RECORDINGS, WHEELS, *SIMULATED, *MOUNTED, *NODE, 'pairs')
QUICK_SCANS, QUICK_COURSE_SCANS, QUICK_PAIRS = 500, 200, 50
QUICK_DRIVES = 3
"""Of each course, in as many worlds or by as many lidars."""
WORKERS = 2


@dataclass(frozen=True)
class Comparison:
    """Two records of one drive."""

    drive: str
    differing: np.ndarray
    """Which of its scans, or pairs, are not the same to the last bit ``(N,)`` bool."""
    largest: dict = field(default_factory=dict)
    """Name of what was recorded -> largest difference, of all that differ; for texts how many differ."""

    @property
    def first(self):
        """The first that differs; None where none does."""
        return int(self.differing.argmax()) if self.differing.any() else None

    def __str__(self):
        if self.first is None:
            return 'equal'
        largest = ', '.join(f'{name} {value:.3g}' for name, value in self.largest.items())
        return f'{self.differing.sum()} differ, from {self.first} on; largest difference: {largest}'


def compare(drive, theirs, ours) -> Comparison:
    """Compare two files of records, bit for bit; what is not a number in both is the same."""
    with np.load(theirs, allow_pickle=False) as first, np.load(ours, allow_pickle=False) as second:
        records = [{name: file[name] for name in file.files} for file in (first, second)]
    count = len(next(iter(records[0].values())))
    differing, largest = np.zeros(count, dtype=bool), {}
    for name in records[0]:
        a, b = (record[name].reshape(count, -1) for record in records)
        is_text = a.dtype.kind == 'U'
        other = a != b if is_text else (a.view(np.int64) != b.view(np.int64)) & ~(np.isnan(a) & np.isnan(b))
        if other.any():
            differing |= other.any(axis=1)
            largest[name] = float(other.sum()) if is_text else float(np.nanmax(
                np.where(other, np.abs(np.nan_to_num(a) - np.nan_to_num(b)), 0.0)))
    return Comparison(drive, differing, largest)


def measure(args) -> Report:
    """Compare this source tree with the commit that ``--against`` names."""
    if unknown := [name for name in args.only or () if name not in GROUPS]:
        raise BenchmarkError(f'unknown drive {unknown[0]!r}; expected {", ".join(GROUPS)}')
    groups, cache = args.only or GROUPS, args.cache or default_cache()
    folder, commit = data_folder(args.data), resolved(args.against)
    trees = built(commit, cache / 'trees'), root()
    files = made_inputs([name for name in groups if name not in NODE], folder, args, cache / 'inputs')
    # Another machine, or other packages, may round differently.
    stamp = hashlib.sha256(machine().encode() + RECORDER.read_bytes()).hexdigest()[:12]
    report, comparisons = Report(), []
    with tempfile.TemporaryDirectory() as scratch:
        targets = cache / 'records' / f'{commit[:12]}-{stamp}', Path(scratch)
        targets[0].mkdir(parents=True, exist_ok=True)
        record(trees, targets, files)
        for name in sorted([*(file.stem for file in files), *record_nodes(groups, args, trees, targets)]):
            comparisons.append(compare(name.partition('-')[0], *(target / f'{name}.npz' for target in targets)))
    for each in comparisons:
        report.metrics[each.drive] = {'scans_count': len(each.differing), 'differ_count': int(each.differing.sum()),
                                      'first_count': -1 if each.first is None else each.first}
        if each.first is not None:
            report.missed.append(f'{each.drive}: {each}')
    report.tables.append(table(comparisons, commit))
    return report


def made_inputs(groups, folder, args, cache) -> list:
    """Return the files of all drives; what was made before is taken from `cache`, both trees are given the same."""
    from dbscan_reg_ros.commands.workers import workers
    limits = [_limit(group, args) for group in groups]
    cache.mkdir(parents=True, exist_ok=True)
    with workers(WORKERS) as executor:
        jobs = [executor.submit(make, *each, folder, cache) for each in zip(groups, limits, strict=True)]
        found = [job.result()[:QUICK_DRIVES if args.quick else None] for job in jobs]
    return list(itertools.chain.from_iterable(found))


def _limit(group, args):
    """How many scans or pairs of a group count; None: all."""
    if not args.quick:
        return args.limit
    most = QUICK_PAIRS if group == 'pairs' else QUICK_COURSE_SCANS if group in SIMULATED else QUICK_SCANS
    return min(args.limit or most, most)


def make(group, limit, folder, cache) -> list:
    """Return the input files of a group, each named by its drive and a digest; write them if they are not there."""
    listed = cache / f'{group}-{limit or "all"}.list'
    if not listed.exists():
        names = []
        for drive, arrays in inputs(group, folder, limit).items():
            digest = hashlib.sha256(b''.join(np.ascontiguousarray(each).tobytes() for each in arrays.values()))
            names.append(f'{drive}-{digest.hexdigest()[:16]}')
            np.savez(cache / f'{names[-1]}.npz', **arrays)
        if not names:
            return []
        listed.write_text('\n'.join(names))
    return [cache / f'{name}.npz' for name in listed.read_text().split()]


def record(trees, targets, files):
    """Write the results of the packages of all `trees` for the input files to the folder of each, unless known."""
    jobs = []
    for tree, target in zip(trees, targets, strict=True):
        new = [file for file in files if not (target / file.name).exists()]
        jobs += [(tree, target, part) for part in (new[k::WORKERS] for k in range(WORKERS)) if part]
    with ThreadPoolExecutor(WORKERS) as executor:
        for tree, problem in executor.map(_recorded, jobs):
            if problem:
                raise BenchmarkError(f'{tree}: the recorder failed: {problem[-500:]}')


def _recorded(job):
    tree, target, files = job
    done = subprocess.run([sys.executable, *map(os.fspath, (RECORDER, tree, target, *files))], cwd=tree, check=False,
                          env=environment(tree), stderr=subprocess.PIPE, text=True)
    return tree, done.stderr.strip() if done.returncode else ''


def record_nodes(groups, args, trees, targets) -> list:
    """Record what the node of each tree answers on the drives of `NODE`; return the names of the records."""
    names = []
    for group in (name for name in groups if name in NODE):
        limit = _limit(group, args)
        names.append(f'{group}-{limit or "all"}')
        for tree, target in zip(trees, targets, strict=True):
            if not (target / f'{names[-1]}.npz').exists():
                np.savez(target / f'{names[-1]}.npz', odom=node_answers(group.removeprefix('node_'), limit, tree))
    return names


def node_answers(kind, limit, tree) -> np.ndarray:
    """Return what the node of a source tree publishes on ``odom`` for the scans of a laser mounted as `kind` says."""
    from dbscan_reg_ros.node.playback.player import Player
    _, scans = mounted(kind, limit)
    words = ['-p', 'publish_tf:=false', '-p', 'advanced.input.max_wait:=10.0', '-p']
    words += ['mounting:=tf'] if kind == 'moving' else [
        'mounting:=laser_pose', '-p', f'laser_pose:={PLACE.as_array().tolist()}', '-p',
        f'upside_down:={str(kind == "upside_down").lower()}']
    channel = Channel('/tf', TRANSFORMS)
    items = [[Played(scan, scan.stamp)] for scan in scans]
    if kind == 'moving':
        known = places(kind, 1e-9 * (np.array([scan.stamp for scan in scans]) - scans[0].stamp))
        moves = [_transform(scan, place) for scan, place in zip(scans, known, strict=True)]
        items = [[Played({'transforms': moves[k:k + 2]}, scan.stamp, channel), *items[k]]
                 for k, scan in enumerate(scans)]
    with graph() as folder, running_node(folder, words=words, tree=tree) as node, Player() as player:
        player.announce([channel])
        player.wait_for_node(PATIENCE)
        deadline = time.monotonic() + PATIENCE
        # A scan whose mounting is not known yet is skipped, and sent again.
        while (begun := player.play(items[0], window=1)).lost and time.monotonic() < deadline:
            continue
        answers = player.play(itertools.chain(*items[1:]), window=1, patience=PATIENCE)
        if begun.lost or answers.lost:
            raise BenchmarkError(f'{tree}: the node gave no odometry for {begun.lost + answers.lost} scans: '
                                 f'{node.output()[-500:]}')
        return np.array([numbers_of(each) for each in (*begun.messages, *answers.messages)])


def _transform(scan, place):
    fields = pose_fields(place)
    return {'header': header_fields(scan.stamp, 'base_link'), 'child_frame_id': scan.frame_id,
            'transform': {'translation': fields['position'], 'rotation': fields['orientation']}}


def table(comparisons, commit) -> str:
    """Return a line for each drive."""
    lines = [f'against {commit[:12]}', *(f'{each.drive:18} {len(each.differing):6}  {each}' for each in comparisons)]
    different = sum(each.first is not None for each in comparisons)
    lines.append(f'{different} of {len(comparisons)} drives differ' if different
                 else f'all {len(comparisons)} drives are equal')
    return '\n'.join(lines)


def inputs(group, folder, limit=None) -> dict:
    """Name -> arrays, as `recorder` reads them, of each drive of a `group`; none where its recording is missing."""
    if group in MOUNTED:
        return {group: packed(mounted(group, limit)[0])}
    try:
        if group in SIMULATED:
            return {f'{group}_{k}': packed(course.scans[:limit]) for k, course in enumerate(COURSES[group](folder))}
        if group == 'pairs':
            return {group: pairs(Intel(folder / 'intel'), limit)}
        recording = open_recording(folder / RECORDINGS[group.removesuffix('_wheels')])
        return {group: with_wheels(recording, limit) if group == WHEELS else packed([*recording.scans()][:limit])}
    except DbscanRegError as missing:
        print(f'left out: {group}: {missing}', file=sys.stderr)
        return {}


def packed(scans, **more) -> dict:
    """Return `Scan`s as plain arrays."""
    geometries = [scan.geometry for scan in scans]
    angles = [(g.angle_min, g.angle_increment, g.range_min, g.range_max, scan.time_increment)
              for g, scan in zip(geometries, scans, strict=True)]
    return {'stamps': np.array([scan.stamp for scan in scans], dtype=np.int64),
            'beams': np.array([g.size for g in geometries]), 'angles': np.array(angles),
            'ranges': np.concatenate([scan.ranges for scan in scans]), **more}


def with_wheels(recording, limit=None) -> dict:
    """Return the scans with the motion since the last one as measured by the wheels."""
    scans = list(recording.scans())[:limit]
    _, wheels = recording.wheel_odometry()
    told = np.vstack((np.full((1, 3), np.nan), relative(wheels[:-1], wheels[1:])))[:len(scans)]
    spreads = np.array([SPREAD(SE2.from_array(np.nan_to_num(motion))) for motion in told])
    return packed(scans, prior=told, prior_covariance=np.einsum('ni,ij->nij', spreads**2, np.eye(3)))


def pairs(log, limit=None) -> dict:
    """Return the first pairs of ``pairs.csv``."""
    chosen = np.array([(i, j) for i, j, _ in log.pairs[:min(limit or PAIRS, PAIRS)]])
    used, numbered = np.unique(chosen, return_inverse=True)
    return packed([log.scans[k] for k in used], pairs=numbered.reshape(-1, 2))


def places(kind, times):
    """(N, 3) where the laser of a `kind` of `MOUNTED` is on the base at `times` [s]."""
    sway = np.sin(2.0 * math.pi * times / SWAY_PERIOD) if kind == 'moving' else np.zeros(len(times))
    return PLACE.as_array() + sway[:, None] * SWAY


def mounted(kind, limit=None):
    """Return a drive through rooms with a laser that sits as `kind` says.

    The scans of an upright sensor that looks along the base, and those of the laser as its driver gives them.
    """
    lidar, world = LIDARS['rplidar_a'], rooms(seed=1)
    path, rng = follow(world.tour[:6], speed=1.0), np.random.default_rng(1)
    times = np.arange(min(limit or MOUNTED_SCANS, MOUNTED_SCANS)) / lidar.rate
    within = lidar.time_increment * np.arange(lidar.beams)
    upright, raw = [], []
    for at, place in zip(times, places(kind, times), strict=True):
        sensor = dataclasses.replace(lidar, mounting=SE2.from_array(place))
        scan = seen(world, path.poses_at(at + within), sensor, rng, round(1e9 * (1e6 + at)), at)
        g, yaw = scan.geometry, float(place[2])
        upright.append(regarded(scan, g.angle_min + yaw, g.angle_increment))
        raw.append(regarded(scan, -g.angle_min, -g.angle_increment) if kind == 'upside_down' else scan)
    return upright, raw


def regarded(scan, angle_min, angle_increment):
    """Return the scan with other bearings."""
    g = scan.geometry
    geometry = ScanGeometry(angle_min, angle_increment, g.size, g.range_min, g.range_max)
    return dataclasses.replace(scan, geometry=geometry)
