"""``replay FILE``: the odometry of a recording, offline, through the same `Odometry` as the node."""
from pathlib import Path

from .command_line import add_recording, make_parser, run


def main(argv=None) -> int:
    parser = make_parser('replay', 'Odometry of a recording, offline, as fast as it goes: '
                         'writes trajectory.tum and map.png and prints how good they are.')
    add_recording(parser)
    parser.add_argument('--params-file', metavar='YAML', help='parameters in the form of ROS 2 (default: the defaults)')
    parser.add_argument('--out', metavar='DIR', help='where the results go (default: results/NAME)')
    return run(parser, replay, argv)


def replay(args):
    """Run the odometry over the recording, write the results and print the summary."""
    from ..core.parameters import Parameters
    from ..parameter_files import read_parameters
    from ..plots import plot_map
    from ..recordings import find_recording, open_recording, write_tum

    recording = open_recording(find_recording(args.file, args.data), args.topic)
    parameters = read_parameters(args.params_file) if args.params_file else Parameters()
    out = Path(args.out or Path('results', recording.name))
    out.mkdir(parents=True, exist_ok=True)
    track = Track(recording)
    try:
        track.follow(parameters)
    finally:
        write_tum(out / 'trajectory.tum', track.stamps, track.poses)
        print(f'trajectory  {out / "trajectory.tum"}')
    plot_map(out / 'map.png', track.scans(), track.poses, f'{recording.name}: {len(track.poses)} scans')
    print(f'map         {out / "map.png"}')
    print('\n'.join(track.summary()))


class Track:
    """The way of a recording's sensor, as the odometry sees it.

    Attributes
    ----------
    stamps : list of int [ns]
    poses : list of (x, y, theta) [m, m, rad]
        One for each scan that could be used, in the order of the file.
    used : list of bool
        For each scan of the recording.
    statuses : list of Status
    milliseconds : list of float
        Time spent on each used scan.
    problems : list of str
        Why scans were not used.
    """

    def __init__(self, recording):
        self.recording = recording
        self.stamps, self.poses, self.used, self.statuses, self.milliseconds, self.problems = [], [], [], [], [], []

    def follow(self, parameters):
        """Feed every scan to an `Odometry`."""
        from time import perf_counter

        from tqdm import tqdm

        from ..core.errors import ScanError
        from ..core.odometry import Odometry

        odometry = Odometry(parameters)
        scans = tqdm(self.recording.scans(), self.recording.name, self.recording.count, unit=' scans', disable=None)
        for number, scan in enumerate(scans, 1):
            begin = perf_counter()
            try:
                update = odometry.process(scan)
            except ScanError as error:
                self.used.append(False)
                self.problems.append(f'scan {number} not used: {error}')
                continue
            self.milliseconds.append(1e3 * (perf_counter() - begin))
            self.used.append(True)
            self.stamps.append(update.stamp)
            self.poses.append((update.pose.x, update.pose.y, update.pose.theta))
            self.statuses.append(update.status)

    def scans(self):
        """The used scans once more."""
        return (scan for scan, used in zip(self.recording.scans(), self.used, strict=True) if used)

    def summary(self):
        """Lines that say how it went."""
        from collections import Counter

        import numpy as np

        counts = Counter(status.value for status in self.statuses)
        yield from self.recording.problems
        yield from self.problems
        yield (f'scans {len(self.used)} lost {self.used.count(False)} '
               + ' '.join(f'{name} {count}' for name, count in sorted(counts.items())))
        if self.milliseconds:
            median, p95 = np.percentile(self.milliseconds, (50, 95))
            yield f'time per scan  median {median:.2f} ms, p95 {p95:.2f} ms'
        yield from self._errors()

    def _errors(self):
        """Errors against what is known of the true motion."""
        from ..recordings import errors_of

        errors = errors_of(self.recording, self.stamps, self.poses)
        for name, words in (('neighbour', 'neighbour relations'), ('all', 'all relations')):
            if f'relations_{name}_mean_m' in errors:
                yield (f'{words}  mean {errors[f"relations_{name}_mean_m"]:.3f} m '
                       f'{errors[f"relations_{name}_mean_deg"]:.2f} deg')
        if 'ate_m' in errors:
            yield 'against the corrected poses  ' + ', '.join(
                f'{name} {errors[key]:.3f} m' for name, key in (
                    ('over 1 m', 'rpe_1m_mean_m'), ('over 5 m', 'rpe_5m_mean_m'), ('ATE', 'ate_m')) if key in errors)
