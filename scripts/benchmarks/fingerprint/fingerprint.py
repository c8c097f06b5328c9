# SPDX-License-Identifier: Apache-2.0
"""Comparison of two commits, bit for bit: both source trees process the same scans on the same machine.

A change that should change nothing must not change a bit.
"""
import contextlib
import hashlib
import io
import itertools
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from dbscan_reg_ros.evaluation.methods import BenchmarkError
from dbscan_reg_ros.recordings import data_folder

from ..report import Report, machine
from .comparison import compare
from .inputs import GROUPS, SIMULATED, inputs

PACKAGE = 'dbscan_reg_ros'
RECORDER = 'scripts/benchmarks/fingerprint/recorder.py'
"""A script of its own: it runs with the package of the other commit, and exchanges messages with its node."""
BESIDE_RECORDER = 'node_recorder.py', 'scan_messages.py'
"""What the script imports from its own folder."""
QUICK_SCANS, QUICK_COURSE_SCANS, QUICK_PAIRS = 500, 200, 50
QUICK_DRIVES = 3
"""Of each course, in as many worlds or by as many lidars."""
WORKERS = 2
LONG = ('outages', 'intel', 'intel_wheels', 'trees', 'rooms', 'halls')
"""Begun first, so that nothing long is left over at the end."""
ONE_THREAD = {'OMP_NUM_THREADS': '1', 'OPENBLAS_NUM_THREADS': '1', 'PYTHONHASHSEED': '0'}


def measure(args) -> Report:
    """Compare this source tree with the commit that ``--against`` names."""
    groups = chosen_groups(args.only)
    folder = data_folder(args.data)
    cache = args.cache or default_cache()
    commit = resolved(args.against)
    report = Report()
    other = built(commit, cache / 'trees')
    with tempfile.TemporaryDirectory() as scratch:
        given = made_inputs(groups, folder, (args.limit, args.quick), cache / 'inputs')
        comparisons = recorded_and_compared(given, other, commit, cache / 'records', Path(scratch))
    for comparison in comparisons:
        report.metrics[comparison.drive] = {'scans_count': comparison.count,
                                            'differ_count': int(comparison.differing.sum()),
                                            'first_count': -1 if comparison.first is None else comparison.first}
        if comparison.first is not None:
            report.missed.append(f'{comparison.drive}: {comparison}')
    report.tables.append(table(comparisons, commit))
    return report


def chosen_groups(only):
    """Return the groups of drives called `only`, or all; BenchmarkError for an unknown one."""
    unknown = [name for name in only or () if name not in GROUPS]
    if unknown:
        raise BenchmarkError(f'unknown drive {unknown[0]!r}; expected {", ".join(GROUPS)}')
    return [name for name in (*LONG, *(name for name in GROUPS if name not in LONG)) if name in (only or GROUPS)]


def root() -> Path:
    """Return the source tree that this module lies in: the first folder above with a ``setup.py``."""
    for folder in Path(__file__).resolve().parents:
        if (folder / 'setup.py').exists():
            return folder
    raise BenchmarkError(f'{__file__}: no source tree around it; run the fingerprint from a checkout')


def _git(*words):
    try:
        return subprocess.run(['git', '-C', os.fspath(root()), *words], capture_output=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        why = getattr(error, 'stderr', b'').decode(errors='replace').strip() or error
        raise BenchmarkError(f'git {" ".join(words)}: {why}') from error


def resolved(commit) -> str:
    """Return the full name of a commit."""
    return _git('rev-parse', '--verify', '--quiet', f'{commit}^{{commit}}').decode().strip()


def default_cache() -> Path:
    """Return the folder in which scans, results and other commits are kept."""
    return root() / 'results' / 'fingerprint'


def built(commit, cache=None) -> Path:
    """Return a folder with the files of a commit and its compiled steps, which are built once."""
    cache = cache or default_cache() / 'trees'
    folder = cache / commit[:12]
    if not folder.exists():
        cache.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=cache) as scratch, \
                tarfile.open(fileobj=io.BytesIO(_git('archive', '--format=tar', commit))) as archive:
            # The archive is that of git itself; older Pythons know no filter.
            options: dict = {'filter': 'data'} if hasattr(tarfile, 'data_filter') else {}
            archive.extractall(Path(scratch, commit), **options)
            compile_steps(Path(scratch, commit))
            Path(scratch, commit).rename(folder)
    return folder


def compile_steps(tree):
    """Build the compiled steps of a source tree in place; BenchmarkError with what the compiler said last."""
    words = [sys.executable, 'setup.py', 'build_ext', '--inplace']
    result = subprocess.run(words, cwd=tree, env=environment(tree, beside=root() / 'build' / 'tools'),
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    if result.returncode or not any((tree / PACKAGE).rglob('*.so')):
        raise BenchmarkError(f'{tree}: cannot be compiled: {"".join(result.stdout.strip().splitlines()[-1:])}')


def made_inputs(groups, folder, size, cache) -> list:
    """(drive, file) of all drives; what was made before is taken from `cache`, for both trees are given the same."""
    target = cache / '-'.join(str(limit_of(name, *size) or 'all') for name in ('intel', 'rooms', 'pairs'))
    target.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(WORKERS) as executor:
        jobs = [executor.submit(_made, group, folder, limit_of(group, *size), target) for group in groups]
        return list(itertools.chain.from_iterable(job.result()[:QUICK_DRIVES if size[1] else None] for job in jobs))


def limit_of(group, limit, quick):
    """How many scans or pairs of a group count; None: all."""
    if not quick:
        return limit
    most = QUICK_PAIRS if group == 'pairs' else QUICK_COURSE_SCANS if group in SIMULATED else QUICK_SCANS
    return min(limit or most, most)


def _made(group, folder, limit, target):
    """In a process of its own, for a thread would share the interpreter with others."""
    complete = target / f'{group}.list'
    if not complete.exists():
        words = [sys.executable, '-c', _MAKE, __package__, group, os.fspath(folder), str(limit or 0), os.fspath(target)]
        result = subprocess.run(words, env=environment(root(), beside=Path(__file__).parents[2]),
                                stderr=subprocess.PIPE, text=True, check=False)
        if result.returncode:
            raise BenchmarkError(f'{group}: the scans cannot be made: {result.stderr.strip().splitlines()[-1]}')
        sys.stderr.write(result.stderr)
    return [(drive, target / f'{drive}.npz') for drive in complete.read_text().split()] if complete.exists() else []


_MAKE = """
import sys
from importlib import import_module
from pathlib import Path
package, group, folder, limit, target = sys.argv[1:]
import_module(package + '.fingerprint').make(group, Path(folder), int(limit) or None, Path(target))
"""


def make(group, folder, limit, target):
    """Write the inputs of a group, and a list of them when all are there."""
    made = inputs(group, folder, limit)
    for drive, arrays in made.items():
        np.savez(target / f'{drive}.npz', **arrays)
    if made:
        part = target / f'{group}.part'
        part.write_text('\n'.join(made))
        part.replace(target / f'{group}.list')


def environment(tree, beside=None, **more):
    """Variables of a process that finds the package in a tree and nowhere else; `beside`: more modules."""
    inherited = [folder for folder in os.environ.get('PYTHONPATH', '').split(os.pathsep)
                 if folder and not Path(folder, PACKAGE).exists()]
    folders = [os.fspath(folder) for folder in (tree, beside) if folder is not None]
    return os.environ | ONE_THREAD | {'PYTHONPATH': os.pathsep.join([*folders, *inherited])} | more


class Recorder:
    """A process that records with the package of one source tree."""

    def __init__(self, tree, script, domain, log):
        variables = environment(tree, ROS_DOMAIN_ID=str(domain))
        self._log = log
        with open(log, 'wb') as output:
            self._process = subprocess.Popen([sys.executable, os.fspath(script), os.fspath(tree)],
                                             stdin=subprocess.PIPE,
                                             stdout=subprocess.PIPE, stderr=output, text=True, cwd=tree,
                                             env=variables)

    def record(self, source, target):
        """Write the results of the package for an input file to another file; BenchmarkError if it fails."""
        try:
            self._process.stdin.write(f'{source}\t{target}\n')
            self._process.stdin.flush()
            answer = self._process.stdout.readline().strip()
        except OSError:
            answer = ''
        if answer != 'done':
            problem = answer or Path(self._log).read_text(errors='replace').strip()[-500:]
            raise BenchmarkError(f'{Path(source).stem}: the recorder failed: {problem}')

    def close(self):
        """End the process."""
        self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()


def recorded_and_compared(given, other, commit, cache, scratch) -> list:
    """Return a `Comparison` of each drive, in the order of their names.

    The records of the other commit are kept in `cache`.
    """
    from tqdm import tqdm

    from dbscan_reg_ros.private_graph import private_graph
    script = scratch / 'recorder.py'
    sources = [root() / RECORDER, *((root() / RECORDER).with_name(name) for name in BESIDE_RECORDER)]
    for source in sources:
        shutil.copyfile(source, scratch / source.name)
    # Another machine, or other packages, may round differently.
    stamp = hashlib.sha256(b''.join([machine().encode(),
                                     *(source.read_bytes() for source in sources)])).hexdigest()[:12]
    with contextlib.ExitStack() as stack:
        domains = [stack.enter_context(private_graph()) for _ in range(WORKERS)]
        local, opened, names = threading.local(), [], iter(range(10**6))

        def recorder_of(tree):
            if not hasattr(local, 'domain'):
                local.domain, local.recorders = domains.pop(), {}
            if tree not in local.recorders:
                local.recorders[tree] = Recorder(tree, script, local.domain, scratch / f'recorder-{next(names)}.log')
                opened.append(local.recorders[tree])
                stack.callback(local.recorders[tree].close)
            return local.recorders[tree]

        def both(item):
            drive, source = item
            ours = scratch / f'{drive}.npz'
            digest = hashlib.sha256(source.read_bytes()).hexdigest()[:16]
            theirs = cache / f'{commit[:12]}-{stamp}' / f'{drive}-{digest}.npz'
            theirs.parent.mkdir(parents=True, exist_ok=True)
            if not theirs.exists():
                recorder_of(other).record(source, theirs)
            recorder_of(root()).record(source, ours)
            return compare(drive, theirs, ours)

        with ThreadPoolExecutor(WORKERS) as executor:
            jobs = executor.map(both, given)
            found = list(tqdm(jobs, 'fingerprint', len(given), unit=' drives', leave=False, disable=None))
    return sorted(found, key=lambda comparison: comparison.drive)


def table(comparisons, commit) -> str:
    """Return a line for each drive."""
    lines = [f'against {commit[:12]}', *(f'{each.drive:18} {each.count:6}  {each}' for each in comparisons)]
    different = sum(each.first is not None for each in comparisons)
    lines.append(f'{different} of {len(comparisons)} drives differ' if different
                 else f'all {len(comparisons)} drives are equal')
    return '\n'.join(lines)
