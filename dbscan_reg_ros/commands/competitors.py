# SPDX-License-Identifier: Apache-2.0
"""Competitors of a comparison: a parameter set, a map, a method, or the trajectory of another program."""
import sys
from dataclasses import dataclass
from pathlib import Path

from ..paths import ready_made
from .command_line import CommandError

MAP = 'map'
"""``map:FILE`` names a competitor that is localised in the map of a file."""


@dataclass(frozen=True)
class Competitor:
    """One competitor: the odometry with `parameters`, in a map or not, a `method`, or a `given` trajectory."""

    name: str
    """Name that the user gave."""
    parameters: object = None
    """NodeParameters"""
    method: str = ''
    """Name of a method, or ``module:function``."""
    given: object = None
    """GivenTrajectory"""
    map: Path | None = None
    """File of the map in which the odometry is localised."""

    @classmethod
    def named(cls, name) -> 'Competitor':
        """Return the competitor that an argument names: a trajectory, method, map, parameter set or parameter file."""
        from ..evaluation.methods import FACTORIES
        from ..robot.parameter_files import read_parameters
        from ..robot.parameters import NodeParameters

        if name in ('defaults', 'dbscan'):
            return cls(name, NodeParameters())
        if Path(name).exists():
            return cls(name, read_parameters(name))
        if '=' in name:
            return cls.with_trajectory(name)
        if name in FACTORIES or ':' in name:
            return cls.with_method(name)
        if name in ready_made():
            return cls(name, read_parameters(name))
        raise CommandError(f'{name}: no such file; expected a parameter file, a parameter set: defaults, '
                           f'{", ".join(ready_made())}; or a method: {", ".join(FACTORIES)}, {MAP}:FILE, '
                           'MODULE:FUNCTION')

    @classmethod
    def with_method(cls, name) -> 'Competitor':
        """Return the competitor that uses the method `name`, the function ``module:function`` or ``map:FILE``."""
        from ..evaluation.trackers import tracker
        from ..robot.parameters import NodeParameters

        kind, _, file = name.partition(':')
        if kind == MAP:
            return cls(name, NodeParameters(), map=Path(file).absolute())
        tracker(name)
        return cls(name, method=name)

    @classmethod
    def with_trajectory(cls, text) -> 'Competitor':
        """Return the competitor ``NAME=FILE[@X,Y,DEG]``: the trajectory of another program."""
        from ..evaluation.matching import GivenTrajectory

        name, _, file = text.partition('=')
        if not name or not file:
            raise CommandError(f'{text}: expected NAME=FILE.tum, NAME=FILE.tum@X,Y,DEG or NAME=FOLDER')
        return cls(name, given=GivenTrajectory.parse(file))

    def follow(self, recording, scans, lidars):
        """Return the `Trajectory` of the competitor over the `scans` of the first lidar of a recording.

        The odometry of a parameter set is that of `replay`, with the scans of the other `lidars`, too. A method or a
        given trajectory uses the first lidar only.
        """
        from ..evaluation.trackers import tracker
        from ..replays.odometry import replayed_trajectory
        from ..replays.trajectory import Trajectory

        if self.parameters:
            return replayed_trajectory(recording, scans, lidars, self.parameters, self.map)
        trajectory = Trajectory()
        if self.given:
            stamps = [scan.stamp for scan in scans]
            self._take(trajectory, stamps, self.given.poses_at(recording.name, stamps))
        else:
            for _ in trajectory.follow(scans, tracker(self.method)):
                pass
        return trajectory

    @staticmethod
    def _take(trajectory, stamps, matched):
        """Fill a `Trajectory` with the poses that a trajectory file has at the `stamps` ``(N,)`` [ns]."""
        from ..core.registration.records import Status

        trajectory.explanation, trajectory.interpolated = matched.explanation, matched.interpolated
        for stamp, pose in zip(stamps, matched.poses.tolist(), strict=True):
            there = pose[0] == pose[0]
            trajectory.used.append(there)
            if there:
                trajectory.stamps.append(stamp)
                trajectory.poses.append(tuple(pose))
                trajectory.statuses.append(Status.OK)


def note_missing(competitors, names):
    """Print which trajectory files the recordings called `names` lack.

    Raises a CommandError when a competitor has no trajectory of any recording, or A, the first one, has none of some
    recording.
    """
    for place, competitor in enumerate(competitors):
        missing = competitor.given.missing(names) if competitor.given else {}
        if not missing:
            continue
        files = ', '.join(map(str, missing.values()))
        if len(missing) == len(set(names)):
            raise CommandError(f'{competitor.name}: no such trajectory: {files}; expected in the folder a file '
                               'RECORDING.tum for each recording, its name without .log.gz, .log or .bag')
        if place == 0:
            raise CommandError(f'{competitor.name}: no such trajectory: {files}; A needs one for each recording: add '
                               'it, leave out the recording, or let another competitor be A')
        print(f'compare: {competitor.name}: no such trajectory: {files}; not judged on {", ".join(missing)}',
              file=sys.stderr)


def first_parameters(competitors):
    """Return the parameters of the first of the `competitors` that has some, to read point clouds with."""
    from ..robot.parameters import NodeParameters
    return next((each.parameters for each in competitors if each.parameters), NodeParameters())


def follow_one(path, lidars, competitor, parameters):
    """Return the `Trajectory` of a competitor over the recording at `path`; the `parameters` are for point clouds.

    A line is printed at the begin: work in several processes has no progress bar.
    """
    from .workers import watched

    lidars = lidars.of_recording(path, parameters)
    recording = lidars.open(path, parameters)
    title = f'{recording.name}, {Path(competitor.name).name}'
    print(f'compare: {title} ...', file=sys.stderr, flush=True)
    return competitor.follow(recording, watched(recording.scans(), title, recording.count), lidars)


def follow_all(executor, paths, lidars, competitors):
    """Run every competitor over every recording; return a list of `Trajectory` for each recording."""
    parameters = [first_parameters((competitor, *competitors)) for competitor in competitors]
    futures = [[executor.submit(follow_one, path, lidars, *each)
                for each in zip(competitors, parameters, strict=True)] for path in paths]
    return [[future.result() for future in row] for row in futures]
