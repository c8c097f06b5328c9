# SPDX-License-Identifier: Apache-2.0
"""``simulate TARGET``: a seeded recording of any lidar with exact truth."""
from .command_line import CommandError, make_parser, run, seed

WORLDS = ('rooms', 'corridor', 'hall')
PRESETS = ('hokuyo_urg04lx', 'hokuyo_utm30lx', 'lds', 'rplidar_a', 'rplidar_s', 'sick_lms200', 'sick_lms5xx')
LIDAR = (
    ('--beams', int, 'N', 'beams'),
    ('--angle-min', float, 'DEG', 'bearing of the first beam'),
    ('--angle-increment', float, 'DEG', 'from beam to beam; negative: clockwise'),
    ('--range-min', float, 'M', 'nearest return'),
    ('--range-max', float, 'M', 'farthest return'),
    ('--rate', float, 'HZ', 'scans a second'),
    ('--duration', float, 'S', 'from the first beam to the last; 0: at once'),
    ('--noise', float, 'M', 'least standard deviation of a range'),
    ('--noise-share', float, 'SHARE', 'the same as a share of the range, where that is more'),
    ('--resolution', float, 'M', 'ranges are multiples of it'),
    ('--dropouts', float, 'SHARE', 'beams without a return, 0..1'),
    ('--outliers', float, 'SHARE', 'random ranges, 0..1'),
)
LIMITS = {
    'people': (0, 1000), 'laps': (1, 1000), 'speed': (0.01, 100.0), 'turn_rate': (0.01, 100.0), 'rate': (0.1, 1000.0),
    'duration': (0.0, 10.0), 'noise': (0.0, 10.0), 'noise_share': (0.0, 1.0), 'resolution': (0.0, 10.0),
    'dropouts': (0.0, 1.0), 'outliers': (0.0, 1.0), 'range_min': (0.0, 1e4), 'range_max': (0.01, 1e6), 'gyro_noise': (0.0, 100.0),
}


def main(argv=None) -> int:
    parser = make_parser('simulate', 'A robot drives through a floor plan and records what its lidar, wheels and '
                         'gyroscope say, with the exact truth. The same arguments give the same recording. A picture '
                         'of the floor plan and the path is written beside it, TARGET.png.')
    parser.add_argument('target', metavar='TARGET', help='NAME.log or NAME.log.gz: CARMEN log, the truth as the poses '
                        'of the laser; any other name: folder of a ROS 2 bag with /scan, /wheel_odom, /imu, /truth and '
                        '/tf_static')
    parser.add_argument('--seed', type=seed, default=0, help='of everything that is random (default: 0)')
    world = parser.add_argument_group('the world and the path')
    world.add_argument('--world', choices=WORLDS, default='rooms', help='what is driven through (default: rooms)')
    world.add_argument('--people', type=int, default=0, metavar='N', help='who walk about (default: 0)')
    world.add_argument('--laps', type=int, default=1, metavar='N', help='the tour forth, back, forth (default: 1)')
    world.add_argument('--speed', type=float, default=0.8, metavar='M/S', help='limit (default: 0.8)')
    world.add_argument('--turn-rate', type=float, default=0.9, metavar='RAD/S', help='limit (default: 0.9)')
    lidar = parser.add_argument_group('the lidar')
    lidar.add_argument('--lidar', choices=PRESETS, default='sick_lms200',
                       help='what the others change, called as the file of parameters that suits it in config '
                       '(default: sick_lms200)')
    for option, kind, unit, words in LIDAR:
        lidar.add_argument(option, type=kind, metavar=unit, help=words)
    lidar.add_argument('--mounting', type=float, nargs=3, metavar=('X', 'Y', 'DEG'),
                       help='on the robot (default: 0 0 0)')
    others = parser.add_argument_group('wheels and gyroscope')
    others.add_argument('--wheel-scale', type=float, nargs=2, default=(1.02, 0.98), metavar=('DISTANCE', 'TURN'),
                        help='measured over true (default: 1.02 0.98)')
    others.add_argument('--wheel-noise', type=float, nargs=2, default=(0.02, 0.02), metavar=('DISTANCE', 'TURN'),
                        help='share of each step and turn (default: 0.02 0.02)')
    others.add_argument('--slip', type=float, nargs=3, action='append', default=[], metavar=('BEGIN', 'END', 'FACTOR'),
                        help='between these times [s] the wheels turn FACTOR times as far; may be given several times')
    others.add_argument('--gyro-bias', type=float, default=0.002, metavar='RAD/S', help='(default: 0.002)')
    others.add_argument('--gyro-noise', type=float, default=0.005, metavar='RAD/S', help='(default: 0.005)')
    return run(parser, simulate, argv)


def simulate(args):
    """Simulate, write the recording and its picture, and print what is in it."""
    from pathlib import Path

    from ..figures.plots import plot_world
    from ..recordings.conversion import check_target
    from ..simulation import simulate as record
    from ..simulation import wheel_odometry, yaw_rates
    from ..simulation.sensors import RobotRecording, check_simulated

    check_limits(args)
    lidar = chosen_lidar(args)
    target = Path(args.target)
    picture = target.with_name(f'{target.name}.png')
    check_simulated(target)
    check_target(picture)
    world, path = world_and_path(args)
    simulation = record(world, path, lidar, args.seed)
    wheels = wheel_odometry(path, seed=args.seed, scale=args.wheel_scale, noise=args.wheel_noise, slips=args.slip)
    turning = yaw_rates(path, seed=args.seed, bias=args.gyro_bias, noise=args.gyro_noise)
    counts = RobotRecording(simulation, wheels, turning).write(target)
    print(f'{target}  ' + ', '.join(f'{count} {name}' for name, count in counts.items()))
    plot_world(picture, world.segments, world.circles, path.poses, [person.route for person in world.people],
               f'{args.world}, seed {args.seed}: {path.length:.0f} m in {path.duration:.0f} s')
    print(f'{picture}  the floor plan and the path')


def check_limits(args):
    """CommandError for the first number that makes no world, path or lidar."""
    for name, (low, high) in LIMITS.items():
        value = getattr(args, name)
        if value is not None and not low <= value <= high:
            raise CommandError(f'--{name.replace("_", "-")} {value}: expected {low:g} to {high:g}')


def chosen_lidar(args):
    """The preset with what was changed of it; CommandError where it can see nothing."""
    import dataclasses
    import math

    from ..core.geometry.se2 import SE2
    from ..simulation import LIDARS

    changes = {}
    for option, *_ in LIDAR:
        name = option[2:].replace('-', '_')
        value = getattr(args, name)
        if value is not None:
            changes[name] = math.radians(value) if name.startswith('angle') else value
    if args.mounting:
        x, y, turn = args.mounting
        changes['mounting'] = SE2(x, y, math.radians(turn))
    lidar = dataclasses.replace(LIDARS[args.lidar], **changes)
    if lidar.range_min >= lidar.range_max:
        raise CommandError(f'--range-min {lidar.range_min:g}: expected less than the greatest range, {lidar.range_max:g} m '
                           '(--range-max)')
    return lidar


def world_and_path(args):
    """The `World` with its people, and the `Path` of the robot."""
    import numpy as np

    from .. import simulation

    world = getattr(simulation, args.world)(seed=args.seed)
    laps = [world.tour[::-1] if lap % 2 else world.tour for lap in range(args.laps)]
    tour = np.concatenate([laps[0], *(lap[1:] for lap in laps[1:])])
    path = simulation.follow(tour, speed=args.speed, turn_rate=args.turn_rate)
    return simulation.with_people(world, args.people, args.seed), path
