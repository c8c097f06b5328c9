# SPDX-License-Identifier: Apache-2.0
"""Source trees of this and of other commits, with their compiled steps."""
import io
import os
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

from dbscan_reg_ros.evaluation.methods import BenchmarkError

PACKAGE = 'dbscan_reg_ros'
ONE_THREAD = {'OMP_NUM_THREADS': '1', 'OPENBLAS_NUM_THREADS': '1', 'PYTHONHASHSEED': '0'}


def root() -> Path:
    """Return the source tree that this module lies in: the first folder above with a ``setup.py``."""
    for folder in Path(__file__).resolve().parents:
        if (folder / 'setup.py').exists():
            return folder
    raise BenchmarkError(f'{__file__}: no source tree around it; run the benchmark from a checkout')


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
            _compile(Path(scratch, commit))
            Path(scratch, commit).rename(folder)
    return folder


def _compile(tree):
    """Build the compiled steps of a source tree in place; BenchmarkError with what the compiler said last."""
    words = [sys.executable, 'setup.py', 'build_ext', '--inplace']
    result = subprocess.run(words, cwd=tree, env=environment(tree, beside=root() / 'build' / 'tools'),
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    if result.returncode or not any((tree / PACKAGE).rglob('*.so')):
        raise BenchmarkError(f'{tree}: cannot be compiled: {"".join(result.stdout.strip().splitlines()[-1:])}')


def environment(tree, beside=None):
    """Variables of a process that finds the package in a tree and nowhere else; `beside`: more modules."""
    inherited = [folder for folder in os.environ.get('PYTHONPATH', '').split(os.pathsep)
                 if folder and not Path(folder, PACKAGE).exists()]
    folders = [os.fspath(folder) for folder in (tree, beside) if folder is not None]
    return os.environ | ONE_THREAD | {'PYTHONPATH': os.pathsep.join([*folders, *inherited])}
