# SPDX-License-Identifier: Apache-2.0
"""``compare A B FILE...``: two parameter sets or methods on the same recordings."""
import itertools
import string
from collections.abc import Sequence
from pathlib import Path

from ..evaluation.method_names import KEY_FRAME_DEGREES, KEY_FRAME_DISTANCE, METHODS
from ..paths import ready_made
from .command_line import (
    FAILED,
    INCOMPLETE,
    SEVERAL,
    CommandError,
    add_mounting,
    add_pictures,
    add_recording,
    add_workers,
    make_parser,
    note_unused,
    note_warnings,
    open_all,
    run,
    seed,
)
from .competitors import MAP, Competitor, first_parameters, follow_all, note_missing

ALL = 'all'
LETTERS = string.ascii_uppercase
"""Letters that denote the competitors in the table."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command with the arguments `argv`; return its exit status."""
    parser = make_parser('compare', 'Run the odometry with A and with B over the same recordings, as replay does, and '
                         'test whether B is worse. Prints one table of all competitors with their errors over 1 m and '
                         '5 m, and APE and RPE as evo computes them where true poses are known; then the paired '
                         'differences of the errors over 1 m with confidence intervals (95 % for translation and '
                         'rotation together; block bootstrap, blocks of 5 m of path; over all motions of all '
                         'recordings). More competitors are compared with A and reported. Of several lidars, methods '
                         'and trajectories use the first one only. doc/faq.md, "Comparing methods", defines every '
                         'column. Exit status 0: B is not worse; 1: B is worse in translation or in rotation (with '
                         '--all: any is); 2: an argument or a recording cannot be used; 3: not worse, but a recording '
                         'is not judged, because B has no pose for more than 10 % of its scans, or because its true '
                         'motion is unknown; then paths, ends, maps and differences are printed.')
    parser.add_argument('a', metavar='A', help='a parameter file; or the name of a ready-made parameter set: '
                        f'defaults, {", ".join(ready_made())}; or a method: {", ".join(METHODS)} (dbscan: the '
                        f'defaults); or {MAP}:FILE, the defaults localised in a map, a file of replay --map-out or the '
                        'map.yaml of an occupancy grid (scans have a pose once it is localised); or MODULE:FUNCTION or '
                        'MODULE:CLASS, as for --method; or NAME=FILE, as for --trajectory')
    parser.add_argument('b', metavar='B', help='as A')
    add_recording(parser, SEVERAL, several=True)
    add_mounting(parser)
    parser.add_argument('--method', metavar='METHOD', action='append', default=[], help='another competitor: a method; '
                        f'or {MAP}:FILE, as A; or MODULE:FUNCTION (a module in the current folder or installed), a '
                        'function (reference, current, guess) that returns the pose (SE2) of the scan current in the '
                        'frame of the scan reference. reference is the last key frame: a scan becomes the key frame if '
                        f'it is more than {KEY_FRAME_DISTANCE:g} m or {KEY_FRAME_DEGREES:g} deg from the last one; '
                        'guess (SE2) is the '
                        'expected result, if the last motion between two scans is repeated. Or MODULE:CLASS, a tracker '
                        'made without arguments: process(scan) returns a Step with the pose in the frame of the first '
                        'scan (doc/faq.md). May be repeated')
    parser.add_argument('--parameters', metavar='YAML', action='append', default=[], help='another competitor: a '
                        'parameter file, or the name of a ready-made parameter set (for example lds); may be repeated')
    parser.add_argument('--trajectory', metavar='NAME=FILE', action='append', default=[], help='another competitor: '
                        'the trajectory of another program in TUM format; NAME=FILE.tum@X,Y,DEG if the file contains '
                        'poses of a body, on which the sensor has the pose X,Y,DEG; NAME=FOLDER with a file '
                        'RECORDING.tum for each recording, its name without .log.gz, .log or .bag (@X,Y,DEG as above); '
                        'recordings without a file are not judged; may be repeated')
    parser.add_argument('--truth', metavar='FILE', help='the true poses of the sensor, for one recording: TUM, or the '
                        'columns index,x,y,theta (default: the true poses in the recording or in a file beside it)')
    parser.add_argument('--all', action='store_true', help='the exit status is 1 if any competitor is worse than A, '
                        'not only B')
    parser.add_argument('--seed', type=seed, default=0, help='seed of the bootstrap (default: 0)')
    parser.add_argument('--out', metavar='DIR', default='results', help='write the table, also as CSV and LaTeX, the '
                        'pictures and the trajectories to DIR/compare/DATE and link it as DIR/compare/latest (default: '
                        'results)')
    add_pictures(parser)
    add_workers(parser)
    return run(parser, compare, argv)


def compare(args):
    """Run all competitors over every recording; print and write the comparison; return the exit `status`."""
    from ..evaluation.competitor_results import describe as describe_results
    from ..evaluation.competitor_results import results_of
    from ..evaluation.known_motion import KnownMotion
    from ..evaluation.without_truth import describe_unjudged, measures_without_truth
    from ..recordings import find_recording
    from ..recordings.truth import read_truth
    from ..replays.lidars import Lidars, parse_mountings
    from ..replays.result_folder import new_folder, point_latest
    from .workers import workers

    competitors = chosen(args)
    paths = [find_recording(file, args.data) for file in args.files]
    if args.truth and len(paths) > 1:
        raise CommandError(f'--truth {args.truth}: expected a single recording; for several, put a '
                           'file truth.tum beside each')
    lidars = Lidars(tuple(args.topic or ()), parse_mountings(args.mounting))
    recordings = open_all(paths, lidars, first_parameters(competitors))
    note_missing(competitors, [recording.name for recording in recordings])
    if args.truth:
        known = [KnownMotion(read_truth(args.truth, recordings[0]), None, None)]
    else:
        known = [KnownMotion.of(recording) for recording in recordings]
    for recording in recordings:
        note_warnings('compare', recording)
    if args.scheduler:
        paths = [path.absolute() for path in paths]
    with workers(args.processes, args.scheduler, len(competitors) * len(paths)) as executor:
        trajectories = follow_all(executor, paths, lidars, competitors)
    names = unique([path.name for path in paths])
    comparisons = compared(dict(zip(names, zip(known, trajectories, strict=True), strict=True)), competitors, args.seed)
    folder = new_folder(Path(args.out) / 'compare')
    folders = [folder / name for name in unique([recording.name for recording in recordings])]
    results = []
    for each in zip(names, folders, known, trajectories, strict=True):
        each[1].mkdir()
        results.append(results_of(*each, comparisons))
    lines = describe_results([*itertools.chain(*results)]) + note_deskewing(competitors, recordings)
    unjudged = {name: measures_without_truth(recording, paths_of)
                for name, recording, motion, paths_of in zip(names, recordings, known, trajectories, strict=True)
                if not motion.is_known}
    named = [f'{letter} {each.name}' for letter, each in zip(LETTERS, competitors, strict=False)]
    tables = [describe_unjudged(name, named, found) for name, found in unjudged.items()]
    text = '\n\n'.join(['\n'.join(lines), *tables, *map(describe, comparisons)])
    print(text, flush=True)
    for name, rows in zip(names, results, strict=True):
        for row, found in zip(rows, unjudged.get(name, ()), strict=False):
            row.notes.append(found.note)
    write_comparison(folder, comparisons, results, text, unjudged)
    write_pictures(args, folders, comparisons, known, trajectories)
    write_pages(folders, recordings, known, trajectories, results)
    point_latest(folder)
    print(f'results  {folder}')
    return status([*comparisons] if args.all else comparisons[:1])


def chosen(args) -> list:
    """Return the competitors named by the arguments, A first; print which of their parameters have no effect."""
    from ..replays.odometry import prior_parameters
    from ..robot.parameters import REPLAYED

    competitors = [*map(Competitor.named, (args.a, args.b)), *map(Competitor.with_method, args.method),
                   *map(Competitor.named, args.parameters), *map(Competitor.with_trajectory, args.trajectory)]
    for competitor in competitors:
        if competitor.parameters:
            used = REPLAYED | prior_parameters(competitor.parameters) | ({'scan_topics'} if args.topic else set())
            note_unused('compare', [competitor.name], competitor.parameters, used)
    return competitors


def note_deskewing(competitors, recordings) -> list:
    """Return a note if some competitors correct the motion during a scan, and others get the scans as measured."""
    corrected = [letter for letter, each in zip(LETTERS, competitors, strict=False)
                 if each.parameters and each.parameters.odometry.deskew]
    measured = [letter for letter, each in zip(LETTERS, competitors, strict=False)
                if each.method not in ('', 'dbscan', 'identity')]
    if not (corrected and measured and any(scan.time_increment for recording in recordings
                                           for scan in itertools.islice(recording.scans(), 1))):
        return []
    return [f'{", ".join(corrected)}: with correction of the motion during a scan; {", ".join(measured)}: scans as '
            'measured. Without this difference: a competitor with odometry.deskew: false in its parameter file']


def unique(names):
    """Make names of competitors distinct: append a number to each repeated name."""
    return [name if names.index(name) == place else f'{name} ({names[:place + 1].count(name)})'
            for place, name in enumerate(names)]


def compared(followed, competitors, seed) -> list:
    """Compare A with each other competitor; return a `Comparison` for each of these.

    `followed` maps the name of a recording to its `KnownMotion` and the `Trajectory` of each of the `competitors`, A
    first.
    """
    from ..evaluation.comparison import MEASURES, Comparison, TooShort, coverage, difference, paired

    comparisons = []
    for place, competitor in enumerate(competitors[1:], 1):
        covered, pairs = {}, {}
        for name, (known, trajectories) in followed.items():
            a, b = trajectories[0], trajectories[place]
            covered[name] = coverage(a, b)
            if not known.is_known:
                continue
            try:
                pairs[name] = paired(known, a, b)
            except TooShort:
                if covered[name] >= Comparison.LEAST_COVERAGE:
                    raise
        judged = [pair for name, pair in pairs.items() if covered[name] >= Comparison.LEAST_COVERAGE]
        groups = {name: [pair] for name, pair in pairs.items()} | ({ALL: judged} if judged else {})
        table = {name: [difference(group, row, seed) for row in range(len(MEASURES))]
                 for name, group in groups.items()}
        comparisons.append(Comparison(LETTERS[place], competitors[0].name, competitor.name, covered, table))
    return comparisons


def status(comparisons) -> int:
    """Return exit status 1 if a competitor is worse than A, else 3 if a recording is not judged, else 0."""
    if any(comparison.worse for comparison in comparisons):
        return FAILED
    return INCOMPLETE if any(comparison.not_judged for comparison in comparisons) else 0


def write_comparison(folder, comparisons, results, text, unjudged):
    """Write table.txt, the same as table.csv and table.tex, and comparison.json."""
    import dataclasses
    import json

    from ..evaluation.competitor_results import csv_table, latex_table

    rows = [*itertools.chain(*results)]
    contents = [{'b': c.b, 'judged': not c.not_judged, 'coverage': c.coverage, 'differences': {
        name: {d.unit: dataclasses.asdict(d) for d in row} for name, row in c.table.items()}} for c in comparisons]
    content = {'table': [each.as_json() for each in rows], 'a': comparisons[0].a, **contents[0],
               'others': contents[1:],
               'without_truth': {name: [*map(dataclasses.asdict, found)] for name, found in unjudged.items()}}
    for name, written in (('table.txt', text + '\n'), ('table.csv', csv_table(rows)), ('table.tex', latex_table(rows)),
                          ('comparison.json', json.dumps(content, indent=1) + '\n')):
        (folder / name).write_text(written, encoding='utf-8')


def write_pictures(args, folders, comparisons, known, trajectories):
    """Draw the differences of each competitor from A, and in the folder of each recording all trajectories."""
    from ..figures.plots import plot_differences, plot_trajectories
    from ..replays.page.drive_data import competitor_lines, known_lines

    titled = args.format == 'png'
    for c in comparisons:
        if c.table:
            names = (Path(c.a).name, Path(c.b).name) if titled else None
            file = 'comparison' if c.letter == 'B' else f'comparison_{c.letter}'
            plot_differences(folders[0].with_name(f'{file}.{args.format}'), c.table, c.letter, names, args.size)
    names = [f'{c.letter}: {Path(c.b).name}' for c in comparisons]
    for folder, motion, (ours, *others) in zip(folders, known, trajectories, strict=True):
        poses = ours.pose_array()
        lines = [(f'A: {Path(comparisons[0].a).name}', poses[:, :2])]
        lines += [(name, way) for _, name, way in (*competitor_lines(ours, zip(names, others, strict=True)),
                                                   *known_lines(motion, ours.stamps, poses))]
        plot_trajectories(folder / f'trajectories.{args.format}', lines, folder.name * titled, args.size)


def write_pages(folders, recordings, known, trajectories, results):
    """Write a page with all competitors into the folder of each recording, and an index of all recordings."""
    from ..replays.page.entries import COMPARISON_COLUMNS, comparison_entry, write_comparison_page
    from ..replays.page.index import write_index

    entries = []
    for folder, *each, rows in zip(folders, recordings, known, trajectories, results, strict=True):
        drawn = write_comparison_page(folder / 'report.html', *each, [f'{row.letter}: {row.name}' for row in rows])
        entries.append(comparison_entry(f'{folder.name}/report.html', drawn, rows))
    title = f'Comparison of {len(results[0])} competitors'
    write_index(folders[0].parent / 'index.html', title, COMPARISON_COLUMNS, entries)


def describe(comparison) -> str:
    """Format a comparison as a table with a concluding sentence."""
    from ..evaluation.comparison import ENOUGH_BLOCKS

    letter, table = comparison.letter, comparison.table
    width = max(len(name) for name in (*table, 'recording'))
    lines = [f'{"recording":{width}}  error over 1 m          A          {letter}      {letter} - A    interval'
             ] if table else []
    for name, row in table.items():
        for d, what in zip(row, ('translation', 'rotation'), strict=True):
            verdict = f'{letter} {d.verdict}' if d.verdict and name not in comparison.not_judged else ''
            lines.append(f'{name:{width}}  {what:11} [{d.unit:>3}] {d.a:10.4f} {d.b:10.4f} {d.b - d.a:+10.4f}    '
                         f'{d.low:+.4f} to {d.high:+.4f}  {verdict}'.rstrip())
    lines += [f'{name:{width}}  {letter} has a pose for {100.0 * fraction:.1f} % of the scans with a pose of A'
              for name, fraction in comparison.coverage.items() if fraction < 1.0]
    lines.append(f'A: {comparison.a}  {letter}: {comparison.b}  {letter} {_conclusion(comparison)}.')
    if ALL in table:
        found = table[ALL][0]
        few = f': fewer than {ENOUGH_BLOCKS}, so that only large differences are found'
        lines.append(f'The verdict rests on {found.motions} motions in {found.blocks} blocks'
                     f'{few if found.blocks < ENOUGH_BLOCKS else ""}.')
    return '\n'.join(lines)


def _conclusion(comparison):
    from ..evaluation.comparison import ALIKE, NOT_DECIDED

    few = f'it has poses for less than {100.0 * comparison.LEAST_COVERAGE:.0f} % of the scans'
    left = comparison.not_judged
    unknown = all(name not in comparison.table and comparison.coverage[name] >= comparison.LEAST_COVERAGE
                  for name in left)
    reason = 'the true motion is unknown' if unknown else few
    judged = [name for name in comparison.coverage if name not in left]
    if not judged:
        return f'is not judged: {reason}'
    verdict = f'is {comparison.verdict(ALL)}'
    if NOT_DECIDED in verdict:
        verdict += (f' (the interval contains 0 and differences of more than {100.0 * ALIKE:.0f} %: expected a longer '
                    'drive, or more of them)')
    if not left:
        return verdict
    return f'{verdict} over {", ".join(judged)}; it is not judged on {", ".join(left)}, where {reason}'
