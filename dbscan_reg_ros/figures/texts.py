# SPDX-License-Identifier: Apache-2.0
"""The result of a registration in words and numbers, as `register` prints it and the pictures show it."""
import math
from typing import NamedTuple

import numpy as np

from ..core.geometry.rounding import fixed
from ..core.geometry.se2 import SE2
from ..core.registration.records import UNKNOWN_HEADING, Status


class Timing(NamedTuple):
    """When two scans were measured."""

    interval: float | None = None
    """Time from the stamp of the reference to that of the current scan [s]; None if unknown."""
    duration: float = 0.0
    """Time that all beams of a scan take [s], the longer one of both; 0 if unknown, or if the motion during the scans
    was removed."""
    moved: tuple[float, float] | None = None
    """Largest motion of the sensor during one of the scans [m], [rad]; None if unknown."""


class LidarOfScan(NamedTuple):
    """The lidar of a scan."""

    number: int
    """Number of the scan among the scans of all lidars."""
    topic: str
    pose: SE2
    """Pose of the lidar in the frame of the first lidar."""


class LidarsOfPair(NamedTuple):
    """The lidars of two scans, of a recording of several lidars."""

    first: str
    """Topic of the first lidar."""
    reference: LidarOfScan
    current: LidarOfScan

    def motion_of(self, transform: SE2) -> SE2:
        """Return the motion of the first lidar from the `transform` between the lidars of both scans."""
        return self.reference.pose @ transform @ self.current.pose.inverse()

    def transform_of(self, motion: SE2) -> SE2:
        """Return the transform between the lidars of both scans from the `motion` of the first lidar."""
        return self.reference.pose.inverse() @ motion @ self.current.pose

    def lines(self, transform: SE2, true: SE2 | None) -> list:
        """Describe the lidars, and the motion of the first one for an estimated and a `true` transform (or None)."""
        scans = [f'{name:11} scan {each.number}, of the lidar on {each.topic}'
                 for name, each in (('reference', self.reference), ('current', self.current))]
        return [*scans, *_describe_motion('motion', self.motion_of(transform), true and self.motion_of(true)),
                f'            of the lidar on {self.first} between the stamps of both scans, in its frame at the first',
                f'transform   {_motion(transform)}',
                f'            of the lidar on {self.current.topic} at the current scan, in the frame of that on '
                f'{self.reference.topic} at the reference']


def status_text(registration) -> str:
    """Return the status as a text; a result of the method of the paper was not checked."""
    return registration.status.value if registration.judged else 'found (the method of the paper has no check)'


def heading_text(variance, factor=1.0) -> str:
    """Return `factor` standard deviations of a heading of this `variance` [rad^2] as a text."""
    sigma = math.sqrt(variance)
    return 'heading unknown' if sigma > UNKNOWN_HEADING else f'heading \u00b1{factor * math.degrees(sigma):.2g} deg'


def describe(steps, timing, covariance=False, lidars=None) -> list:
    """Describe the registration of `Steps` in lines of text, with its `covariance` if asked for.

    Where the true motion is known the error is given as well. `lidars` are the `LidarsOfPair` of several lidars.
    """
    found, truth = steps.registration, steps.truth
    reason = f': {found.reason}' if found.reason else ''
    lines = [f'status      {status_text(found)}{reason}',
             *(lidars.lines(found.transform, truth) if lidars else
               _describe_motion('transform', found.transform, truth))]
    if truth is not None and found.status is not Status.OK and not steps.by_paper:
        score, overlap = steps.score_at(truth)
        lines.append(f'            at the true motion: score {fixed(score, 3)}, overlap {overlap:.3f}')
    spread = found.covariance_in_reference
    lines += [f'sigma       {_sigma(spread)}, in the frame of the reference']
    if covariance:
        lines += ['covariance  of x, y [m] and theta [rad], in the frame of the reference',
                  *('            ' + ' '.join(f'{value:12.4e}' for value in row) for row in spread)]
    if timing.interval is not None:
        lines.append(f'time        {fixed(timing.interval, 3)} s from the reference to the current scan')
    lines += _describe_motion_during_scan(steps, timing)
    if not steps.by_paper:
        lines.append(f'overlap     {found.overlap:.3f}')
    lines += _describe_evidence(found)
    if found.degenerate_direction is not None:
        degrees = fixed(math.degrees(found.degenerate_direction), 1)
        lines.append(f'unobservable translation along {degrees} deg of the reference')
    if found.rotation_unobservable:
        lines.append('unobservable rotation')
    lines.append(f'hypotheses  {len(found.hypotheses)}, best first')
    lines += [f'            score {fixed(h.score, 3)}  {_log_odds(h)}{_motion(h.transform)}'
              f'{"  rival" if h in found.rivals else ""}' for h in found.hypotheses]
    return lines


def _describe_motion(name, motion, truth) -> list:
    """Describe a motion, and its error where the `truth` is not None."""
    lines = [f'{name:11} {_motion(motion)}']
    if truth is not None:
        error = truth.inverse() @ motion
        lines += [f'true        {_motion(truth)}',
                  f'error       {math.hypot(error.x, error.y):.4f} m  {math.degrees(abs(error.theta)):.3f} deg']
    return lines


def _describe_motion_during_scan(steps, timing) -> list:
    """Return a note where the motion during a scan may exceed the standard deviations of the result."""
    if not timing.duration:
        return []
    scan = f'note        each scan lasts {timing.duration:.2f} s, and the '
    kept = ('. It is not removed here (the odometry removes it), and sigma and confidence do not include the error, up '
            'to about as much')
    if timing.moved is None:
        return [f'{scan}motion during it is unknown; at 90 deg/s it would be {90.0 * timing.duration:.1f} deg{kept}']
    distance, angle = timing.moved
    sigma = np.sqrt(np.diag(steps.registration.covariance))
    if distance <= sigma[:2].max() and angle <= sigma[2]:
        return []
    return [f'{scan}sensor moved by up to {distance:.3f} m and {math.degrees(angle):.2f} deg during it (by the scans '
            f'before and after){kept}']


def _log_odds(hypothesis) -> str:
    return f'log-odds {fixed(hypothesis.log_odds, 2):>6}  ' if math.isfinite(hypothesis.log_odds) else ''


def _describe_evidence(registration) -> list:
    """Describe the confidence in a motion and the evidence for it in lines of text."""
    evidence, margin = registration.evidence, registration.margin
    if evidence is None:
        return []
    rival = f'the log-odds of the best rival are {fixed(margin, 2)} less' if registration.rivals else 'no rival'
    return [f'confidence  {registration.confidence:.3f}',
            f'evidence    log-odds {fixed(registration.hypotheses[0].log_odds, 2)}, {rival}',
            f'            points in the free space of the other scan: {100 * evidence.conflicts_current:.1f} % of the '
            f'current scan, {100 * evidence.conflicts_reference:.1f} % of the reference',
            f'            corners and free ends: {evidence.matched_ends} match, {evidence.unmatched_ends} that the '
            'other should see do not',
            f'            matched walls across their main direction: {evidence.crossing:.1f} m',
            f'            {registration.weakest_information:.1f} points constrain the weakest direction, '
            f'residual {evidence.residual:.3f} m']


def _sigma(covariance) -> str:
    x, y, theta = np.sqrt(np.diag(covariance))
    heading = 'heading unknown' if theta > UNKNOWN_HEADING else f'theta {math.degrees(theta):.3f} deg'
    return f'x {x:.4f} m  y {y:.4f} m  {heading}'


def _motion(transform) -> str:
    x, y, degrees = fixed(transform.x, 4), fixed(transform.y, 4), fixed(math.degrees(transform.theta), 3)
    return f'x {x} m  y {y} m  theta {degrees} deg'
