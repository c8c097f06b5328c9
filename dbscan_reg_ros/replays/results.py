# SPDX-License-Identifier: Apache-2.0
"""Write the result files of a replay; if one of them cannot be written, all others are written nevertheless."""
import numpy as np

from ..evaluation.known_motion import NOTHING_KNOWN, KnownMotion
from ..evaluation.metrics import align
from ..figures.plots import MapPoints, draw_map
from ..places.pose_graph import write_g2o
from ..recordings import write_tum
from ..recordings.poses import compose
from .animation import Track, write_animation
from .in_map import InMap
from .lidars import received
from .loops import Loops
from .occupancy_map import write_occupancy_map
from .page.entries import replay_entry
from .page.index import DriveEntry
from .page.report import ClosedMap, Report, write_report
from .page.scan_history import ScanHistory
from .pairs_to_review import PairsToReview
from .result_folder import new_folder
from .summary import describe_contradictions, describe_recordings, summarise, write_metrics
from .trajectory import Trajectory


class Results:
    """What a replay collects of each scan, and the files that it writes of it.

    Parameters
    ----------
    recording : Recording
        Recording with the topic of the first lidar.
    odometry : ReplayOdometry
    options : argparse.Namespace
        Arguments of ``replay``.
    faults : Faults
        Collects the results that cannot be written, with the reasons.

    Attributes
    ----------
    folder : Path
        A new folder of its own.
    trajectory : Trajectory
    entry : DriveEntry or None
        Entry in the index of several replays, set when the results are written.
    """

    def __init__(self, recording, odometry, options, faults):
        self.recording, self.odometry, self.faults = recording, odometry, faults
        self.parameters, mounting, self._options = odometry.parameters, odometry.mounting, options
        yaw = mounting.pose.theta
        self.trajectory = Trajectory(yaw, mounting.upside_down, numbers=odometry.numbers if odometry.recordings else [])
        self.to_review, self.history = PairsToReview(), ScanHistory(yaw)
        self.map_points = MapPoints(recording.count, yaw)
        closes = options.close_loops or options.g2o or options.map_out
        self.loops = Loops(self.parameters.for_odometry()) if closes else None
        self.in_map = InMap(options.map, self.parameters.for_odometry(), yaw) if options.map else None
        self._on_base = mounting.pose if options.frame == 'base' else None
        self.entry: DriveEntry | None = None
        self.folder = new_folder(options.out / recording.name)

    def write(self, register='') -> list:
        """Write metrics, pictures and page; return the summary as (name, text) pairs.

        `register` is the command that shows a pair of scans if their numbers are appended.
        """
        recordings = [self.recording, *self.odometry.recordings]
        counts = self.odometry.counts if self.odometry.recordings else {}
        stamps, poses, name = self.trajectory.stamps, self.trajectory.pose_array(), self.recording.name
        known, measures = self._known(), self.trajectory.measures(self.parameters.time.max_jump)
        measures |= self.faults.attempt('errors against the truth', known.measures, stamps, poses) or {}
        closed = self.faults.attempt('closed.tum', self._close, known, measures) if self.loops else None
        # Not all scans are in it if one could not be added.
        in_map = self.in_map if self.in_map and len(self.in_map.moments) == len(poses) else None
        if in_map:
            measures |= self.faults.attempt('errors in the map', in_map.measures, known) or {}
        bodies = self.odometry.bodies.found(self.parameters)
        write_metrics(self.folder / 'metrics.json', recordings, measures, counts, bodies)
        truth = self.faults.attempt('truth.tum', self._truth, known)
        closed_map = self._draw_closed(closed, truth) if closed else None
        title = f'{name}: {len(poses)} scans'
        density = self._draw('map.png', poses, title, truth)
        summary = [*describe_recordings(recordings, counts, bodies, self._on_base is not None),
                   *describe_contradictions(self.trajectory), *summarise(measures),
                   *_without_truth(known, stamps)]
        if in_map:
            self.faults.attempt('in_map.tum', write_tum, self.folder / 'in_map.tum', *in_map.trajectory())
            summary.append(('in the map', in_map.line(measures)))
        if self._options.grid:
            placed = self.map_points.placed(closed[0] if closed else poses, self.trajectory.registered)
            self.faults.attempt('map.pgm', write_occupancy_map, self.folder, placed, self._options.grid)
        if density and self._options.animation:
            self.faults.attempt('animation.gif', self._animate, density, closed_map)
        if density:
            with self.faults.noted('report.html'):
                lines = [('recording', str(self.recording.path)), *summary]
                report = Report(title, lines, known, self.trajectory, density, self._pairs(), self.parameters, register,
                                self.history, closed_map, in_map=in_map,
                                index='../../index.html' if len(self._options.files) > 1 else '')
                write_report(self.folder / 'report.html', report)
                self.entry = replay_entry(name, self.folder, measures, density, _lines(poses, _aligned(truth, poses)))
        return summary

    def write_poses(self, file, stamps, poses):
        """Write poses ``(N, 3)`` that begin at the origin as TUM `file`, those of the lidar or of the base."""
        poses = np.asarray(poses, dtype=float).reshape(-1, 3)
        write_tum(self.folder / file, stamps, poses if self._on_base is None else
                  compose(np.array([self._on_base.as_tuple()]), self._of_base(poses)))

    def _of_base(self, poses):
        """Return the poses of the base for those of the lidar ``(N, 3)``, if poses of the base are asked for."""
        return poses if self._on_base is None else compose(poses, np.array([self._on_base.inverse().as_tuple()]))

    def _known(self):
        return self.faults.attempt('errors against the truth', KnownMotion.of, self.recording) or NOTHING_KNOWN

    def _truth(self, known):
        """Return the true poses ``(N, 3)`` of the scans, nan if unknown; None if the recording has no truth."""
        if known.truth is None:
            return None
        truth = known.true_poses(self.trajectory.stamps).poses
        there = np.isfinite(truth).all(axis=1)
        stamps = np.array(self.trajectory.stamps, dtype=np.int64)[there]
        write_tum(self.folder / 'truth.tum', stamps, self._of_base(truth[there]))
        return truth

    def _close(self, known, measures):
        """Close the loops, add their error measures; return the corrected poses and the pairs of scans of the loops."""
        closed, mapper = self.loops.poses(self.trajectory.yaw), self.loops.mapper
        pairs = np.array([loop.pair for loop in self.loops.found], dtype=int).reshape(-1, 2)
        errors = self.faults.attempt('errors against the truth', known.measures, self.trajectory.stamps, closed) or {}
        measures |= {'loops': len(pairs)} | {f'closed_{name}': value for name, value in errors.items()}
        self.write_poses('closed.tum', self.trajectory.stamps, closed)
        if file := self._options.map_out:
            place = self.odometry.mounting.aligned_pose
            self.faults.attempt(str(file), mapper.map(place).save, file)
        if self._options.g2o:
            self.faults.attempt('graph.g2o', write_g2o, self.folder / 'graph.g2o', mapper.graph)
        return closed, pairs

    def _draw_closed(self, closed, truth):
        """Draw the map from the poses after loop closing; return the `ClosedMap`, or None if it cannot be drawn."""
        poses, pairs = closed
        title = f'{self.recording.name}: {len(poses)} scans, {len(pairs)} places seen again'
        density = self._draw('map_closed.png', poses, title, truth)
        return ClosedMap(poses, pairs, density) if density else None

    def _draw(self, file, poses, title, truth):
        """Draw the map from the poses; return the `DensityMap`, or None if it cannot be drawn."""
        density = self.faults.attempt(file, self.map_points.density, poses)
        if density:
            self.faults.attempt(file, draw_map, self.folder / file, density, poses, title, _aligned(truth, poses))
        return density

    def _animate(self, density, closed):
        found = self.trajectory
        scans = found.usable(received(self.recording.scans(), self.parameters.input_of(self.recording.topic)))
        write_animation(self.folder / 'animation.gif', scans, Track(found.pose_array(), found.stamps, density),
                        closed and Track(closed.poses, found.stamps, closed.density))

    def _pairs(self):
        return self.faults.attempt('pairs to review', self.to_review.found) or []


def _lines(poses, truth):
    """Return kind, name and positions of the trajectories that the small map in the index shows."""
    lines = [('trajectory', 'trajectory', poses[:, :2])]
    return lines if truth is None else [*lines, ('truth', 'truth', truth[:, :2])]


def _aligned(truth, poses):
    """Return the true poses, rigidly aligned to the `poses`, NaN where unknown; None if fewer than two are known."""
    if truth is None:
        return None
    there, aligned = np.isfinite(truth).all(axis=1), np.full(truth.shape, np.nan)
    if there.sum() <= 1:
        return None
    aligned[there] = align(truth[there], poses[there])
    return aligned


def _without_truth(known, stamps):
    """Return a line of the summary on scans without a true pose; no line if all have one or none can have one."""
    poses, explanation, _ = known.true_poses(stamps)
    return [('true poses', explanation)] if known.truth and np.isnan(poses).any() else []
