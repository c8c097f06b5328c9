# SPDX-License-Identifier: Apache-2.0
"""Write the result files of a replay; if one of them cannot be written, all others are written nevertheless."""
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..core.geometry.se2 import SE2
from ..evaluation.known_motion import NOTHING_KNOWN, KnownMotion
from ..evaluation.metrics import align
from ..figures.plots import MapPoints, draw_map
from ..places.map import Map
from ..places.pose_graph import write_g2o
from ..recordings import write_tum
from ..recordings.poses import compose
from ..recordings.recording import Recording
from ..robot.parameters import NodeParameters
from .animation import Track, write_animation
from .faults import Faults
from .in_map import InMap
from .lidars import received
from .loops import Loops
from .occupancy_map import write_occupancy_map
from .odometry import ReplayOdometry
from .own_bodies import OwnBodies
from .page.entries import replay_entry
from .page.index import DriveEntry
from .page.report import ClosedMap, Report, write_report
from .page.scan_history import ScanHistory
from .pairs_to_review import PairsToReview
from .summary import describe_contradictions, describe_recordings, summarise, write_metrics
from .trajectory import Trajectory


@dataclass(eq=False)
class Results:
    """Results of a replay and the folder they are written to.

    Attributes
    ----------
    folder : Path
    recording : Recording
    parameters : NodeParameters
    trajectory : Trajectory
    to_review : PairsToReview
    loops : Loops or None
        Key frames for loop closing; None if loops are not closed.
    faults : Faults
        Collects the results that cannot be written, with the reasons.
    history : ScanHistory
        Data of each scan that the page shows.
    map_points : MapPoints
        Returns of the scans that the odometry used.
    animation : bool
        Whether to write animation.gif as well.
    index : str
        Address of the index of several replays, relative to the page; empty without an index.
    lidars : ReplayOdometry or None
        The odometry of several lidars; None for a single lidar.
    grid : float or None
        Side of the cells of the occupancy grid [m]; None: no grid is written.
    bodies : OwnBodies or None
        Finds where the lidars see the robot itself; None if that is not searched.
    on_base : SE2 or None
        Pose of the lidar on the base, where the files of poses have those of the base; None: those of the lidar.
    map_out : Path or None
        File of the map of key frames; None: it is not written.
    g2o : bool
        Write the pose graph.
    mounting : SE2
        Pose of the scans on the robot, as the odometry receives them.
    in_map : InMap or None
        The drive in a map that is known before.
    entry : DriveEntry or None
        Entry in the index of several replays, set when the results are written.
    """

    folder: Path
    recording: Recording
    parameters: NodeParameters
    trajectory: Trajectory
    to_review: PairsToReview
    loops: Loops | None
    faults: Faults
    history: ScanHistory
    map_points: MapPoints
    animation: bool = False
    index: str = ''
    lidars: ReplayOdometry | None = None
    grid: float | None = None
    bodies: OwnBodies | None = None
    on_base: SE2 | None = None
    map_out: Path | None = None
    g2o: bool = False
    mounting: SE2 = field(default_factory=SE2)
    in_map: InMap | None = None
    entry: DriveEntry | None = None

    def write(self, register='') -> list:
        """Write metrics, pictures and page; return the summary as (name, text) pairs.

        `register` is the command that shows a pair of scans if their numbers are appended.
        """
        recordings, counts = [self.recording], {}
        if self.lidars:
            recordings, counts = [*recordings, *self.lidars.recordings], self.lidars.counts
        stamps, poses, name = self.trajectory.stamps, self.trajectory.pose_array(), self.recording.name
        known, measures = self._known(), self.trajectory.measures(self.parameters.time.max_jump)
        measures |= self.faults.attempt('errors against the truth', known.measures, stamps, poses) or {}
        closed = self.faults.attempt('closed.tum', self._close, known, measures) if self.loops else None
        bodies = self.bodies.found(self.parameters) if self.bodies else []
        write_metrics(self.folder / 'metrics.json', recordings, measures, counts, bodies)
        truth = self.faults.attempt('truth.tum', self._truth, known)
        closed_map = self._draw_closed(closed, truth) if closed else None
        title = f'{name}: {len(poses)} scans'
        density = self._draw('map.png', poses, title, truth)
        summary = [*describe_recordings(recordings, counts, bodies, self.on_base is not None),
                   *describe_contradictions(self.trajectory), *summarise(measures),
                   *_without_truth(known, stamps)]
        if self.in_map:
            self.faults.attempt('in_map.tum', write_tum, self.folder / 'in_map.tum', self.in_map.stamps,
                                self.in_map.pose_array())
            summary.append(('in the map', self.in_map.line()))
        if self.grid:
            placed = self.map_points.placed(closed[0] if closed else poses, self.trajectory.registered)
            self.faults.attempt('map.pgm', write_occupancy_map, self.folder, placed, self.grid)
        if density and self.animation:
            self.faults.attempt('animation.gif', self._animate, density, closed_map)
        if density:
            with self.faults.noted('report.html'):
                lines = [('recording', str(self.recording.path)), *summary]
                report = Report(title, lines, known, self.trajectory, density, self._pairs(), self.parameters, register,
                                self.history, closed_map, index=self.index)
                write_report(self.folder / 'report.html', report)
                self.entry = replay_entry(name, self.folder, measures, density, _lines(poses, _aligned(truth, poses)))
        return summary

    def write_poses(self, file, stamps, poses):
        """Write poses ``(N, 3)`` that begin at the origin as TUM `file`, those of the lidar or of the base."""
        poses = np.asarray(poses, dtype=float).reshape(-1, 3)
        write_tum(self.folder / file, stamps, poses if self.on_base is None else
                  compose(np.array([self.on_base.as_tuple()]), self._of_base(poses)))

    def _of_base(self, poses):
        """Return the poses of the base for those of the lidar ``(N, 3)``, if poses of the base are asked for."""
        return poses if self.on_base is None else compose(poses, np.array([self.on_base.inverse().as_tuple()]))

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
        poses = self.trajectory.pose_array()
        closed, pairs, graph = self.loops.close(poses, self.parameters.for_odometry(), self.trajectory.yaw)
        errors = self.faults.attempt('errors against the truth', known.measures, self.trajectory.stamps, closed) or {}
        measures |= {'loops': len(pairs)} | {f'closed_{name}': value for name, value in errors.items()}
        self.write_poses('closed.tum', self.trajectory.stamps, closed)
        if self.map_out:
            self.faults.attempt(str(self.map_out), Map.of_drive(self.loops, graph, self.mounting).save, self.map_out)
        if self.g2o:
            self.faults.attempt('graph.g2o', write_g2o, self.folder / 'graph.g2o', graph)
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
