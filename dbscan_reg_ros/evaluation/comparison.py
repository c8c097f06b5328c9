# SPDX-License-Identifier: Apache-2.0
"""Comparison of the errors of two methods, or parameter sets, on the same scans."""
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.errors import RecordingError
from ..recordings.poses import relative
from .known_motion import KnownMotion
from .metrics import apart, errors, path_lengths, related

METRES = 1.0
"""Distance [m] over which the errors of the motion are computed."""
FARTHER_METRES = 5.0
"""Distance [m] over which the mean errors are reported, too, without a verdict."""
BLOCK_METRES = 5.0
"""Errors within this distance [m] are treated as correlated and resampled together."""
FEWEST_BLOCKS = 8
ENOUGH_BLOCKS = 20
"""With fewer blocks of errors than this, only large differences are found."""
DRAWS = 2000
MEASURES = ('m', 'deg')
ALIKE = 0.3
"""Errors are alike if the confidence interval of their difference lies within this fraction of the larger one."""
NOT_DECIDED = 'not decided'


class TooShort(RecordingError):
    """The true motion is known for too few scans to compute errors."""


@dataclass(frozen=True, eq=False)
class Paired:
    """Errors of A and of B for the same N motions."""

    a: np.ndarray
    b: np.ndarray
    """Errors of translation [m] and of rotation [deg], in the order of the scans ``(2, N)``."""
    block: int
    """Number of successive errors that are treated as correlated."""

    @property
    def blocks(self) -> int:
        """Number of blocks of the errors, the last one shorter or complete."""
        return -(-self.a.shape[1] // self.block)


@dataclass(frozen=True)
class Difference:
    """Mean errors of A and of B, and the confidence interval of their difference B - A."""

    a: float
    b: float
    """Mean errors [m] or [deg]."""
    low: float
    high: float
    """Limits of the confidence interval of B - A [m] or [deg]."""
    unit: str
    motions: int
    """Number of motions whose errors are compared."""
    blocks: int
    """Number of blocks of motions with correlated errors."""

    @property
    def worse(self):
        """Whether the whole confidence interval of B - A is above 0."""
        return self.low > 0.0

    @property
    def better(self):
        """Whether the whole confidence interval of B - A is below 0."""
        return self.high < 0.0

    @property
    def alike(self):
        """Whether the whole confidence interval of B - A is close to 0."""
        return max(abs(self.low), abs(self.high)) <= ALIKE * max(self.a, self.b)

    @property
    def verdict(self) -> str:
        """``worse`` or ``better``, if the whole confidence interval of B - A is above or below 0.

        Else empty, if the errors are alike, or `NOT_DECIDED`.
        """
        return 'worse' if self.worse else 'better' if self.better else '' if self.alike else NOT_DECIDED


@dataclass(frozen=True, eq=False)
class Comparison:
    """Comparison of a competitor with the first one, called A."""

    LEAST_COVERAGE = 0.9
    """Minimum `coverage` of a recording for a verdict."""

    letter: str
    """Letter of the competitor in the printed table."""
    a: str
    b: str
    """Names of A and of the competitor."""
    coverage: dict
    """Recording -> fraction of the scans with a pose of A that also have a pose of the competitor."""
    table: dict
    """Recording, or ``all`` for the judged recordings together -> `Difference` of translation and of rotation."""

    @property
    def not_judged(self) -> list:
        """Recordings whose coverage does not suffice for a verdict, or whose true motion is unknown."""
        return [name for name, fraction in self.coverage.items()
                if fraction < self.LEAST_COVERAGE or name not in self.table]

    @property
    def worse(self) -> bool:
        """Whether the error of the competitor is significantly larger than the error of A."""
        return any(d.worse for d in self.table.get('all', ()))

    def verdict(self, recording) -> str:
        """Return in words whether the competitor is better or worse than A on a recording, or on ``all``."""
        if recording in self.not_judged or recording not in self.table:
            return 'not judged'
        row = self.table[recording]
        words = [f'{d.verdict} in {what}'
                 for d, what in zip(row, ('translation', 'rotation'), strict=True) if d.verdict]
        if any(d.worse or d.better for d in row) or len(words) == 1:
            return ' and '.join(words)
        return NOT_DECIDED if words else 'neither better nor worse'


def coverage(trajectory_a, trajectory_b) -> float:
    """Return the fraction of the scans with a pose in trajectory A that also have a pose in trajectory B."""
    a, b = np.array(trajectory_a.used, dtype=bool), np.array(trajectory_b.used, dtype=bool)
    return float((a & b).sum() / max(a.sum(), 1))


def known_motion(recording) -> KnownMotion:
    """Return the `KnownMotion` of a recording; raise RecordingError if it has neither truth nor relations."""
    known = KnownMotion.of(recording)
    if not (known.truth or known.relations):
        problem = f'; {recording.problems[-1]}' if recording.problems else ''
        raise RecordingError(f'{recording.path}: its true motion is unknown; expected poses, relations or '
                             f'reference.csv{problem}')
    return known


def paired(known: KnownMotion, trajectory_a, trajectory_b) -> Paired:
    """Compute the errors of two trajectories over 1 m of the true path, or without true poses over the relations.

    Raises a RecordingError when the true motion is unknown; `TooShort` when the true motion is known for too few scans.
    """
    scans, stamps, poses = _common(trajectory_a, trajectory_b)
    true = _true_motions(known, stamps, poses[0], scans)
    count = len(true.first)
    if not count and known.truth:
        raise TooShort(f'too few scans have a true pose: {known.true_poses(stamps).explanation}')
    if count < FEWEST_BLOCKS:
        raise TooShort(f'{count} motions with known truth; expected at least {FEWEST_BLOCKS}: compare a longer drive, '
                       'or more of its scans')
    a, b = (np.array(errors(relative(found[true.first], found[true.second]), true.motions)) for found in poses)
    block = int(np.ceil(BLOCK_METRES * count / max(true.length, BLOCK_METRES)))
    return Paired(a, b, min(block, count // FEWEST_BLOCKS))


def mean_errors(known: KnownMotion, trajectory_a, trajectory_b, metres) -> tuple[float, float] | None:
    """Return the mean errors of trajectory B over `metres` of the true path: translation [m], rotation [deg].

    As in `paired`, only scans with poses of both A and B are used. The result is None without true poses, or if no two
    scans are `metres` apart.
    """
    found, true = motions_over(known, trajectory_a, trajectory_b, metres)
    if not len(found):
        return None
    metre, degree = errors(found, true)
    return float(metre.mean()), float(degree.mean())


def motions_over(known: KnownMotion, trajectory_a, trajectory_b, metres):
    """Return the motions of trajectory B over `metres` of the true path and the true ones, both ``(K, 3)`` [m, m, rad].

    Only scans with poses of both A and B are used. There are none without true poses.
    """
    if not known.truth:
        return np.empty((0, 3)), np.empty((0, 3))
    scans, stamps, (_, poses) = _common(trajectory_a, trajectory_b)
    truth = known.true_poses(stamps).poses
    first, second = apart(truth, metres, scans)
    return relative(poses[first], poses[second]), relative(truth[first], truth[second])


def _common(trajectory_a, trajectory_b):
    """Return the numbers of the scans with poses in both trajectories, their stamps [ns], and the poses of A and B."""
    both = np.array(trajectory_a.used, dtype=bool) & np.array(trajectory_b.used, dtype=bool)
    row_a, row_b = (both[np.array(trajectory.used, dtype=bool)] for trajectory in (trajectory_a, trajectory_b))
    stamps = np.array(trajectory_a.stamps, dtype=np.int64)[row_a]
    return np.flatnonzero(both), stamps, (trajectory_a.pose_array()[row_a], trajectory_b.pose_array()[row_b])


class _TrueMotions(NamedTuple):
    """True motions ``(K, 3)`` [m, m, rad] from scans `first` to scans `second` ``(K,)``, and path length [m]."""

    first: np.ndarray
    second: np.ndarray
    motions: np.ndarray
    length: float


def _true_motions(known: KnownMotion, stamps, poses, scans) -> _TrueMotions:
    """Return true motions over 1 m of path at `stamps` ``(N,)`` [ns], or without true poses those of `relations`.

    None spans a hole between the numbers of the `scans` ``(N,)``.

    The path length is that of the true poses, or if there are none that of the estimated `poses` ``(N, 3)``
    [m, m, rad].
    """
    if known.truth:
        truth = known.true_poses(stamps).poses
        first, second = apart(truth, METRES, scans)
        driven = path_lengths(truth[np.isfinite(truth).all(axis=1)])
        return _TrueMotions(first, second, relative(truth[first], truth[second]), driven[-1] if len(driven) else 0.0)
    if known.relations:
        first, second, found = related(stamps, known.relations)
        return _TrueMotions(first, second, known.relations.motions[found], path_lengths(poses)[-1])
    raise RecordingError('the true motion is unknown; expected poses, relations or reference.csv')


def difference(pairs, row, seed=0, confidence=0.975) -> Difference:
    """Compute the difference of the mean errors over one or several recordings with a block bootstrap.

    Blocks of successive errors, which are correlated, are resampled within each recording, `DRAWS` times. The
    confidence interval is computed from Student's t distribution about the mean, with the standard deviation of the
    draws and as many degrees of freedom as there are blocks, less the number of recordings.

    Parameters
    ----------
    pairs : sequence of Paired
    row : int
        Errors that are compared: 0 for translation, 1 for rotation.
    seed : int
    confidence : float
        Probability that the interval contains the true difference. The default gives a probability of 95 % that both
        the interval of translation and the interval of rotation contain it.
    """
    from scipy.stats import t

    rng = np.random.default_rng(seed)
    total, sums, freedom = 0, np.zeros(DRAWS), 0
    for pair in pairs:
        values = pair.b[row] - pair.a[row]
        count, blocks = len(values), pair.blocks
        around = np.concatenate(([0.0], np.cumsum(np.concatenate((values, values[:pair.block])))))
        of_block = around[pair.block:pair.block + count] - around[:count]
        drawn = of_block[rng.integers(count, size=(DRAWS, blocks))].sum(axis=1) / (blocks * pair.block)
        spread = np.sqrt(blocks / (blocks - 1.0))
        sums += count * (values.mean() + spread * (drawn - values.mean()))
        total += count
        freedom += blocks - 1
    a, b = (float(sum(side[row].sum() for side in sides) / total)
            for sides in ([pair.a for pair in pairs], [pair.b for pair in pairs]))
    half = float(t.ppf(0.5 + 0.5 * confidence, freedom) * np.std(sums / total))
    return Difference(a, b, b - a - half, b - a + half, MEASURES[row], total, freedom + len(pairs))
