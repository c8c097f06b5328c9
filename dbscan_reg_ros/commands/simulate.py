# SPDX-License-Identifier: Apache-2.0
"""``simulate TARGET``: write a simulated recording of any lidar with exact truth, reproducible from a seed."""
import argparse
from collections.abc import Sequence

from .command_line import CommandError, make_parser, run, seed

WORLDS = ('rooms', 'corridor', 'hall')
PRESETS = ('depth_camera', 'gazebo', 'hokuyo_urg04lx', 'hokuyo_utm30lx', 'ldrobot_ld19', 'ldrobot_stl27l', 'lds',
           'lds_01', 'lds_02', 'lds_03', 'omron_os32c', 'oradar_ms200', 'pepperl_fuchs_r2000', 'pilz_psenscan',
           'rplidar_a', 'rplidar_a1', 'rplidar_c1', 'rplidar_s', 'sick_lms200', 'sick_lms5xx', 'sick_microscan3',
           'sick_tim', 'ydlidar_g', 'ydlidar_g6', 'ydlidar_tg', 'ydlidar_x2', 'ydlidar_x4')
LIDAR = (
    ('--beams', int, 'N', 'number of beams'),
    ('--angle-min', float, 'DEG', 'bearing of the first beam'),
    ('--angle-increment', float, 'DEG', 'angle between beams; negative: clockwise'),
    ('--range-min', float, 'M', 'smallest range of a return'),
    ('--range-max', float, 'M', 'largest range of a return'),
    ('--rate', float, 'HZ', 'scans per second'),
    ('--duration', float, 'S', 'time of one scan, from its first to its last beam (not of the drive); 0: all beams at '
     'once (default: that of the model, shorter if --rate is higher than its rate)'),
    ('--noise', float, 'M', 'smallest standard deviation of a range'),
    ('--noise-share', float, 'FRACTION', 'standard deviation of a range as a fraction of the range, used if '
                    'larger than --noise'),
    ('--resolution', float, 'M', 'ranges are rounded to multiples of this'),
    ('--dropouts', float, 'FRACTION', 'fraction of beams without a return, 0..1'),
    ('--outliers', float, 'FRACTION', 'fraction of beams with a random range, 0..1, as cross-talk of lidars causes'),
    ('--phase', float, 'S', 'time from the start of the drive to the first scan'),
)
LIMITS = {
    'people': (0, 1000), 'laps': (1, 1000), 'seconds': (1.0, 86400.0), 'speed': (0.01, 100.0),
    'turn_rate': (0.01, 100.0), 'rate': (0.1, 1000.0), 'duration': (0.0, 86400.0), 'noise': (0.0, 10.0),
    'noise_share': (0.0, 1.0), 'resolution': (0.0, 10.0), 'phase': (0.0, 10.0), 'dropouts': (0.0, 1.0),
    'outliers': (0.0, 1.0), 'range_min': (0.0, 1e4), 'range_max': (0.01, 1e6), 'gyro_noise': (0.0, 100.0),
}


class LidarOption(argparse.Action):
    """Store the options of the lidars in their order: each option belongs to the lidar named before it."""

    def __call__(self, parser, namespace, values, option_string=None):
        """Add a value to the options of the last lidar; a second ``--lidar`` begins another; ``--body`` is a list."""
        lidars = [dict(options) for options in namespace.lidars]
        if self.dest == 'lidar' and 'lidar' in lidars[-1]:
            lidars.append({})
        lidars[-1][self.dest] = [*lidars[-1].get('body', []), values] if self.dest == 'body' else values
        namespace.lidars = lidars


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command with the arguments `argv`; return its exit status."""
    parser = make_parser('simulate', 'Simulate a robot that drives through a floor plan, and record its lidar, wheel '
                         'odometry and gyroscope with the exact truth. The same arguments give the same recording. '
                         'Also draws the floor plan and the path as TARGET.png.')
    parser.add_argument('target', metavar='TARGET', help='NAME.log or NAME.log.gz: CARMEN log, the truth as the poses '
                        'of the laser; any other name: folder of a ROS 2 bag with /scan, /wheel_odom, /imu, /truth and '
                        '/tf_static, and of further lidars /scan_2, /scan_3 and so on')
    parser.add_argument('--seed', type=seed, default=0, help='seed of all random numbers (default: 0)')
    world = parser.add_argument_group('the world and the path')
    world.add_argument('--world', choices=WORLDS, default='rooms', help='kind of floor plan (default: rooms)')
    world.add_argument('--people', type=int, default=0, metavar='N',
                       help='number of people who walk about (default: 0)')
    world.add_argument('--laps', type=int, metavar='N', help='number of laps, alternately forwards and backwards '
                       '(default: 1, or as many as --seconds takes)')
    world.add_argument('--seconds', type=float, metavar='S', help='time after which the drive ends (default: when the '
                        'laps are complete)')
    world.add_argument('--speed', type=float, default=0.8, metavar='M/S', help='largest speed (default: 0.8)')
    world.add_argument('--turn-rate', type=float, default=0.9, metavar='RAD/S', help='largest turn rate (default: 0.9)')
    parser.set_defaults(lidars=[{}])
    lidar = parser.add_argument_group('the lidar')
    lidar.add_argument('--lidar', choices=PRESETS, action=LidarOption,
                       help='lidar model, as doc/sensors.md describes it and its driver sends it; the options below '
                       'override its properties. If given again, it adds another lidar to the robot, and the '
                       'options after it apply to that lidar; the true poses are those of the first lidar (default: '
                       'sick_lms200)')
    for option, kind, unit, words in LIDAR:
        lidar.add_argument(option, type=kind, metavar=unit, action=LidarOption, help=words)
    lidar.add_argument('--mounting', '--at', type=float, action=LidarOption, nargs=3, metavar=('X', 'Y', 'DEG'),
                       help='pose of the lidar on the robot (default: 0 0 0)')
    lidar.add_argument('--body', type=float, action=LidarOption, nargs=3, metavar=('FROM', 'TO', 'RANGE'),
                       help='the lidar sees the robot itself between the bearings FROM and TO [deg], at RANGE [m]; may '
                       'be repeated')
    others = parser.add_argument_group('wheels and gyroscope')
    others.add_argument('--wheel-scale', type=float, nargs=2, default=(1.02, 0.98), metavar=('DISTANCE', 'ROTATION'),
                        help='ratio of measured to true distance and rotation (default: 1.02 0.98)')
    others.add_argument('--wheel-noise', type=float, nargs=2, default=(0.02, 0.02), metavar=('DISTANCE', 'ROTATION'),
                        help='standard deviation of the error of a step, as a fraction of its distance and of its '
                             'rotation (default: 0.02 0.02)')
    others.add_argument('--slip', type=float, nargs=3, action='append', default=[], metavar=('BEGIN', 'END', 'FACTOR'),
                        help='between these times [s] the wheels measure FACTOR times the distance; may be repeated')
    others.add_argument('--gyro-bias', type=float, default=0.002, metavar='RAD/S',
                        help='constant error of the yaw rate (default: 0.002)')
    others.add_argument('--gyro-noise', type=float, default=0.005, metavar='RAD/S',
                        help='noise of the yaw rate (default: 0.005)')
    return run(parser, simulate, argv)


def simulate(args):
    """Simulate a drive, write the recording and its picture, and print the contents of the recording."""
    from pathlib import Path

    from ..figures.plots import plot_world
    from ..recordings.conversion import check_target
    from ..simulation import WheelErrors, wheel_odometry, yaw_rates
    from ..simulation import simulate as record
    from ..simulation.recording import RobotRecording, check_simulated

    check_limits(args)
    target = Path(args.target)
    lidars = chosen_lidars(args.lidars, target)
    picture = target.with_name(f'{target.name}.png')
    check_simulated(target)
    check_target(picture)
    world, path = world_and_path(args)
    simulation, *others = (record(world, path, lidar, args.seed + number) for number, lidar in enumerate(lidars))
    if not all(each.scans for each in (simulation, *others)):
        raise CommandError(f'the drive of {path.duration:.1f} s ends before the first scan of a lidar; expected more '
                           '--seconds, or less --phase and --duration')
    wheels = wheel_odometry(path, WheelErrors(args.wheel_scale, args.wheel_noise, args.slip), seed=args.seed)
    turning = yaw_rates(path, seed=args.seed, bias=args.gyro_bias, noise=args.gyro_noise)
    counts = RobotRecording(simulation, wheels, turning, tuple(others)).write(target)
    print(f'{target}  ' + ', '.join(f'{count} {name}' for name, count in counts.items()))
    plot_world(picture, world.segments, world.circles, path.poses, [person.route for person in world.people],
               f'{args.world}, seed {args.seed}: {path.length:.0f} m in {path.duration:.0f} s')
    print(f'{picture}  the floor plan and the path')


def check_limits(args):
    """Raise CommandError for the first numeric option outside its limits."""
    for options in (vars(args), *args.lidars):
        for name, (low, high) in LIMITS.items():
            value = options.get(name)
            if value is not None and not low <= value <= high:
                raise CommandError(f'--{name.replace("_", "-")} {value}: expected {low:g} to {high:g}')


def chosen_lidars(lidars, target):
    """Return the lidars that the options define, each with its own frame; raise CommandError for several in a log."""
    import dataclasses

    if len(lidars) > 1 and target.name.endswith(('.log', '.log.gz')):
        raise CommandError(f'{target}: a CARMEN log can contain only one lidar; expected the folder of a bag')
    first, *others = map(chosen_lidar, lidars)
    return [first, *(dataclasses.replace(other, frame_id=f'{other.frame_id}_{number}')
                     for number, other in enumerate(others, 2))]


def chosen_lidar(options):
    """Return the lidar model with the given changes; raise CommandError if options contradict each other."""
    import dataclasses
    import math

    from .. import simulation
    from ..core.geometry.se2 import SE2

    changes = {}
    for option, *_ in LIDAR:
        name = option[2:].replace('-', '_')
        value = options.get(name)
        if value is not None:
            changes[name] = math.radians(value) if name.startswith('angle') else value
    if 'range_min' in changes or 'range_max' in changes:
        changes['stated'] = ()
    if options.get('mounting'):
        x, y, turn = options['mounting']
        changes['mounting'] = SE2(x, y, math.radians(turn))
    changes['body'] = tuple((math.radians(first), math.radians(last), own)
                            for first, last, own in options.get('body', ()))
    model = simulation.PRESETS[options.get('lidar', 'sick_lms200')]
    # A lidar with more scans per second turns faster.
    faster = max(1.0, changes.get('rate', model.rate) / model.rate)
    lidar = dataclasses.replace(model, **{'duration': model.duration / faster, **changes})
    if lidar.duration * lidar.rate > 1.0 + 1e-9:
        raise CommandError(f'--duration {lidar.duration:g}: expected at most {1.0 / lidar.rate:g} s, the time between '
                           'two scans (--rate); --seconds is the time of the drive')
    if lidar.range_min >= lidar.range_max:
        raise CommandError(f'--range-min {lidar.range_min:g}: expected less than the greatest range, '
                           f'{lidar.range_max:g} m (--range-max)')
    return lidar


def world_and_path(args):
    """Return the `World` with its people, and the `Path` of the robot."""
    import math

    import numpy as np

    from .. import simulation

    world = getattr(simulation, args.world)(seed=args.seed)
    limits = {'speed': args.speed, 'turn_rate': args.turn_rate}
    count = args.laps or 1
    if args.seconds and not args.laps:
        count = math.ceil(args.seconds / simulation.follow(world.tour, **limits).duration)
    laps = [world.tour[::-1] if lap % 2 else world.tour for lap in range(count)]
    path = simulation.follow(np.concatenate([laps[0], *(lap[1:] for lap in laps[1:])]), **limits)
    if args.seconds:
        path = path.until(args.seconds)
    return simulation.with_people(world, args.people, args.seed), path
