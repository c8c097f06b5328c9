# SPDX-License-Identifier: Apache-2.0
"""``calibrate FILE``: estimate mounting and time offset of each further lidar of a recording."""
from collections.abc import Sequence
from pathlib import Path

from .command_line import CommandError, add_parameters, add_recording, make_parser, run, shortened


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command with the arguments `argv`; return its exit status."""
    parser = make_parser('calibrate', 'Estimate the mounting and the time offset of each further lidar of a recording '
                         'relative to the first lidar, whose mounting counts as right: each scan is located in the map '
                         'that the first lidar builds while it drives. Prints them with standard deviations, and a '
                         'joint for a URDF file. What the drive does not determine is "not observable": drive curves, '
                         'and with different speeds. Exit status 2: an argument or the recording cannot be used; 130: '
                         'interrupted; 1: any other failure.')
    add_recording(parser, {'action': 'append', 'required': True, 'help': 'topic of the scans of a lidar, first that '
                           'of the first lidar; given at least twice'})
    parser.add_argument('--mounting', action='append', nargs='+', metavar='WORD', help='TOPIC X Y DEG [upside_down]: '
                        'pose of the lidar of a topic on the base [m, m, deg]; for further lidars a guess is enough; '
                        'may be repeated (default: laser_pose of the lidar in the parameter file, else that of the '
                        'recording, as for replay)')
    add_parameters(parser)
    parser.add_argument('--json', type=Path, metavar='FILE', help='also write the results to this file')
    return run(parser, calibrate, argv)


def calibrate(args):
    """Compare the lidars; print the results, and write them to the JSON file."""
    import json

    from ..recordings import find_recording
    from ..replays.lidar_calibration import calibrate_lidars
    from ..replays.lidars import Lidars, further_lidars, given_mountings, mounting_in, parse_mountings
    from ..robot.parameter_files import read_parameters
    from .workers import watched

    parameters = read_parameters(args.params_file)
    mountings = given_mountings(parameters, args.topic) | parse_mountings(args.mounting)
    path = find_recording(args.file, args.data)
    lidars = Lidars(tuple(args.topic), mountings).of_recording(path, parameters)
    if len(lidars.topics) == 1:
        raise CommandError(f'--topic {args.topic[0]}: expected two topics or more: one lidar has nothing to be '
                           'compared with')
    recording, base_frame = lidars.open(path, parameters), parameters.base_frame
    first = mounting_in(recording, mountings, base_frame)
    others = further_lidars(recording, lidars.topics[1:], mountings, parameters)
    results = calibrate_lidars(recording, first, others, parameters,
                               lambda scans: watched(scans, recording.name, recording.count))
    for each in (recording, *(other.recording for other in others)):
        for problem in shortened(each.problems):
            print(f'{each.topic}: {problem}')
    for result in results:
        for name, value in result.lines(base_frame):
            print(f'{name:11} {value}' if name != 'joint' else value)
    if args.json:
        content = {'file': str(recording.path), 'first': recording.topic,
                   'lidars': [result.measures(base_frame) for result in results]}
        args.json.write_text(json.dumps(content, indent=1, allow_nan=False) + '\n', encoding='utf-8')
