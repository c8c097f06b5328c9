# SPDX-License-Identifier: Apache-2.0
"""Laser odometry: keeps key frames, registers every scan to them and integrates the pose."""
import copy
import dataclasses
import math
from typing import NamedTuple

import numpy as np

from ..features.extraction import extract_features, scan_noise_ratio
from ..features.range_noise import NoiseRatioHistory
from ..features.records import Features
from ..features.small_objects import with_poles
from ..geometry.se2 import SE2, turned
from ..geometry.symmetric_matrix import inverse, mahalanobis
from ..parameters.tree import Parameters
from ..registration.pipeline import register, register_within_gate
from ..registration.records import Prior, Registration, Status
from ..registration.status import demoted_if_weak, observability_ratio
from ..scan import Scan
from .deskew import deskew
from .mapping.dynamic_points import without_dynamic_points
from .mapping.key_frame_window import KeyFrame, KeyFrameWindow
from .mapping.scan_to_map import facing, align_to_map, alignment_uncertainty, sees_new_surface
from .models.covariance import CovariancePropagation
from .models.manhattan import ManhattanHeading
from .models.motion import ConstantVelocityModel, unknown_motion_covariance
from .models.stamps import ScanInterval, StampFilter
from .models.wheel_calibration import WheelCalibration
from .models.zero_velocity import ZeroVelocityUpdate
from .records import OdometryUpdate


class Odometry:
    """Poses from a stream of scans.

    Parameters
    ----------
    parameters : Parameters
        May be replaced at any time; a new value counts from the next scan on, what key frames hold stays as it is.
    """

    def __init__(self, parameters: Parameters = Parameters()):
        self.parameters = parameters
        self._number = 0
        self.reset()

    @property
    def parameters(self):
        return self._parameters

    @parameters.setter
    def parameters(self, parameters):
        self._parameters = self._search = parameters
        if parameters.odometry.reference == 'window':
            # The window has the last word on the pose. What it does not hold a scan by, a single key frame does not either.
            less = dataclasses.replace(parameters.refinement, polish_iterations=0)
            steep = dataclasses.replace(parameters.decision, parallel_tolerance=max(parameters.decision.parallel_tolerance, parameters.degeneracy.parallel_tolerance))
            self._search = dataclasses.replace(parameters, refinement=less, decision=steep)

    def reset(self, pose: SE2 = SE2()):
        """Forget everything; the next scan is the first one, at `pose`."""
        self._pose, self._reported, self._drift = pose, pose, CovariancePropagation()
        # Headings are corrected in what is reported; scans are registered as if they were not.
        self._straight = SE2()
        self._window, self._systematic = None, WheelCalibration()
        self._intervals, self._scan_lasts = StampFilter(), 0.0
        self._noise_share = NoiseRatioHistory()
        self._forget()

    def _forget(self):
        """Know nothing of the motion."""
        self._motion, self._rest = ConstantVelocityModel(self._pose), ZeroVelocityUpdate(self._pose)
        self._drift.halt()
        self._walls = ManhattanHeading()
        self._lost, self._pending, self._near, self._fresh = 0.0, None, True, True
        self._firm, self._found = 0.0, None

    def _halt(self):
        """Expect no motion."""
        self._motion.halt()
        self._drift.halt()

    def process(self, scan: Scan, prior: Prior | None = None) -> OdometryUpdate:
        """Register `scan` and say where the sensor is.

        Parameters
        ----------
        scan : Scan
        prior : Prior, optional
            The sensor's motion since the last scan, from elsewhere (wheels, a gyroscope). What is wrong with whole motions
            time and again is learned (`prior.calibration_distance`). Without a prior the last motion is expected to go on, unless
            `odometry.prior` says otherwise.

        Raises
        ------
        ScanError
            When the scan holds too few returns to be used; the state is unchanged.
        """
        p = self.parameters
        lasts = abs(scan.time_increment) * scan.geometry.size if p.odometry.deskew else 0.0
        lasts = self._scan_lasts = lasts if lasts < p.time.max_jump else 0.0
        skewed = lasts and not self._intervals.jumps(scan.stamp, p.time)
        share = self._intervals.share(lasts)
        features = self._features(scan, share * self._motion.twist) if skewed else self._features(scan)
        half = _half(scan, features, share) if lasts else 0.0
        time = self._intervals.next(scan.stamp, half, p.time, lasts)
        if self._window is None or time.jump.startswith('stamps'):
            return self._start(features, time.jump)
        if time.jump:
            self._halt()
        self._motion.wait(time.interval)
        own = self._motion.expected(time, p)
        given = prior or own
        told = _is_told(given, own)
        prior = self._systematic.corrected(given) if told else given
        expected = _Expected(self._pose @ prior.transform, prior, self._pose @ own.transform, own, time)
        found = self._register(features, expected)
        if skewed and self._drives_off(found, time):
            features, time = self._begin_moving(scan, found.pose, time, self._intervals.share(lasts))
            expected = expected._replace(time=time)
            found = self._register(features, expected)
        self._fresh = False
        if found.frame is None:
            return self._coast(features, found.registration, expected)
        before, firm = self._pose, self._firm
        update = self._follow(found, expected)
        self._firm = observability_ratio(found.registration, p.decision) if update.status is Status.OK else 0.0
        if told and not time.gap and self._agrees(self._pose, expected.pose, given.covariance):
            self._learn(given, before.inverse() @ self._pose, min(firm, self._firm))
        return update

    def predict_motion(self, stamp) -> Prior | None:
        """What is expected of the motion to a scan at `stamp` [ns] when nobody tells of it; None before the first scan."""
        if self._window is None:
            return None
        time = copy.deepcopy(self._intervals).next(stamp, 0.0, self.parameters.time, self._scan_lasts)
        return self._motion.expected(time, self.parameters)

    def _features(self, scan, twist=(0.0, 0.0, 0.0), again=False):
        """Of a scan, looked at for the first time or `again`, without the motion within it, at a `twist` [m/s, m/s, rad/s]."""
        p = self.parameters
        scan = deskew(scan, twist)
        share = self._noise_share if again else self._noise_share.after(scan_noise_ratio(scan, p.scan))
        features = extract_features(scan, p, share.value)
        self._noise_share = share
        return with_poles(features, p.odometry.pole_size, p.segments) if p.odometry.pole_size else features

    def _drives_off(self, found, time):
        """Whether the scan after a start tells of a motion, and all of it."""
        registration = found.registration
        if not self._fresh or found.frame is None or registration.status is not Status.OK or time.gap or time.interval <= 0.0:
            return False
        moved = (self._pose.inverse() @ found.pose).as_array()
        return mahalanobis(moved, registration.covariance) > self.parameters.odometry.zero_velocity_gate ** 2

    def _begin_moving(self, scan, pose, time, share):
        """Begin again with the first scan, now that the motion is known: it is taken out of the first scan, and of the next, found at `pose`.

        Returns the features and the time of the next.
        """
        twist = (self._pose.inverse() @ pose).as_array() / time.interval
        first, features = (self._features(each, share * twist, again=True) for each in (self._window.latest.features.scan, scan))
        time = dataclasses.replace(time, half=_half(scan, features, share))
        self._window = KeyFrameWindow((KeyFrame(first, self._pose, number=self._window.latest.number),))
        self._motion.start_moving(self._pose, twist, time.half)
        return features, time

    def _register(self, features, expected):
        """Register to the local map, or where that leads nowhere, or leaves a direction free, to other `_references`.

        What moves is left out where the motion is expected to better than the margin. A direction that the scans leave free is
        left to what was expected.
        """
        p, (place_expected, prior, usual, own, time) = self.parameters, expected
        precise = prior.spread < p.odometry.dynamic_margin
        still = without_dynamic_points(features, place_expected, self._window, p) if precise else features
        vague = prior.spread > p.decision.weak_prior_sigma or p.prior.gate * prior.rotation_sigma > _QUARTER
        around, usual_around = (self._motion.reach(each, at, self._lost, p) for each, at in ((prior, place_expected), (own, usual)))
        slips = expected.told and not self._agrees(place_expected, usual, own.covariance)
        tried, faint, angle, pending = [], None, None, self._pending
        self._pending = None
        for frame, reference in self._references(place_expected, tried):
            guess = Prior(frame.pose.inverse() @ place_expected, prior.covariance)
            registration, seen = self._match(reference, frame.pose, features, still, guess)
            tried.append(registration)
            if registration.status is Status.FAILED:
                continue
            pose, angle = _level(frame, registration, place_expected, angle)
            # In doubt, and out of reach: a corridor looks the same from its other end, and what is within reach may be hardly worse.
            if (registration.status is not Status.OK and precise and not self._lost
                    and not self._agrees(pose, place_expected, around) and not self._agrees(pose, usual, usual_around)):
                near = register_within_gate(reference, seen, self._search, guess)
                if near.status is not Status.FAILED:
                    registration = dataclasses.replace(near, status=registration.status, reason=registration.reason)
                    pose, angle = _level(frame, registration, place_expected, angle)
            found = _Found(frame, pose, registration, seen)
            # A corridor looks the same to who has turned back: so far from what is vaguely expected nothing doubtful is believed.
            doubtful = registration.status is not Status.OK and vague
            share = _DOUBTFUL if doubtful else 1.0
            # A few points that speak against what was told are not believed for a while, but where wheels seem to slip.
            sure = not expected.told or observability_ratio(registration, p.decision) == 1.0 or self._lost > p.odometry.coast_time
            if (self._agrees(pose, place_expected, around, share) or (sure or slips)
                    and self._agrees(pose, usual, usual_around if sure else own.covariance, share)):
                if registration.degenerate_direction is None and (faint is None or registration.status is Status.OK):
                    return found
                faint = faint or found
                if registration.rotation_unobservable or facing(seen, pose, angle, p).sum() < p.decision.min_information:
                    break
            elif sure and registration.status is Status.OK and faint is None:
                # Against all that was expected: a leap is believed when the next scan says the same.
                if self._agrees(pose, usual, unknown_motion_covariance(time, p)) or (
                        pending is not None and self._agrees(pose, pending @ own.transform, own.covariance)):
                    if self._lost:
                        # From where it was only expected to be: a correction, no motion.
                        self._motion.lose()
                    return found
                self._pending = self._pending or pose
        return faint or _Found(None, None, tried[0], None)

    def _learn(self, told, found, weights):
        """Learn what is wrong with a motion that was `told`, now that it is `found`."""
        memory = self.parameters.prior.calibration_distance
        if memory:
            self._systematic.learn(told, found, weights, memory)
        else:
            self._systematic = WheelCalibration()

    def _references(self, expected, tried):
        """What a scan is compared to, one after the other, each with the key frame whose frame it is in; `tried` holds the results.

        The local map, and the nearest of the older key frames at last. In between the latest key frame, and the last scan that
        was found, if it was one. Where the map failed completely its parts would, too: of the key frames only those are left that
        lie nearer to where the scan is expected than the latest.
        """
        *older, latest = self._window.frames
        yield latest, self._window.local_map
        glimmers = self._glimmers(tried[0])
        if glimmers and self._window.local_map is not latest.features:
            yield latest, latest.features
        turned_away = abs((latest.pose.inverse() @ expected).theta) > self.parameters.odometry.key_frame_angle
        if self._found is not None and turned_away and tried[0].status is Status.FAILED:
            yield self._found, self._found.features

        def way(frame):
            return math.hypot(frame.pose.x - expected.x, frame.pose.y - expected.y)
        older = sorted((frame for frame in older if glimmers or way(frame) < way(latest)), key=way)
        yield from ((frame, frame.features) for frame in older[:self.parameters.odometry.older_key_frames])

    def _match(self, reference, pose, features, still, guess):
        """The scan without what moves registered to a reference that lies at a `pose`, and what was registered.

        What moves is known from where the scan was expected. Where that led nowhere, but not quite, it is known from where
        the scan seems to be.
        """
        p = self.parameters
        registration = register(reference, still, self._search, guess, self._near)
        # Where scores are too low for a search near the prior to be enough they are so for a while.
        self._near = registration.score > p.prior.enough
        if registration.status is not Status.FAILED or not self._glimmers(registration):
            return registration, still
        there = without_dynamic_points(features, pose @ registration.transform, self._window, p)
        if there.normals is still.normals:
            return registration, still
        return register(reference, there, self._search, guess), there

    def _glimmers(self, registration):
        """Whether a place that may have failed is worth a second look."""
        return registration.score >= _GLIMMER * self.parameters.decision.min_score

    def _agrees(self, pose, expected, covariance, share=1.0):
        """Whether the pose lies within `share` of `prior.gate` of what is expected."""
        off = (expected.inverse() @ pose).as_array()
        return mahalanobis(off, covariance) <= (share * self.parameters.prior.gate) ** 2

    def _follow(self, found, expected):
        """The scan is found: align it with the window, and make it a key frame when it is due."""
        p, (frame, pose, registration, features), (place_expected, prior, _, own, time) = self.parameters, found, expected
        registration = demoted_if_weak(registration, prior, p.decision)
        known, angle = np.zeros((3, 3)), None
        if registration.degenerate_direction is not None:
            angle = frame.pose.theta + registration.degenerate_direction
        if expected.told:
            sharp = self._systematic.sharpened(prior)
            prior = sharp if self._agrees(pose, place_expected, sharp.covariance) else prior
        if self._agrees(pose, place_expected, prior.covariance):
            known = inverse(prior.covariance)
        if p.odometry.reference == 'window':
            turns = registration.rotation_unobservable and prior is not own and known.any()
            pose, correspondences = align_to_map(self._window, features, pose, place_expected, known, angle, turns, p)
            matched, held = alignment_uncertainty(features, pose, correspondences, p, angle is not None, registration.rotation_unobservable)
            free, weak = held.angle, held.weak
        else:
            matched, free, weak, correspondences = registration.covariance, angle, registration.weakest_information, None
        share = 1.0 if angle is None else min(weak / p.decision.min_information, 1.0)
        covariance = inverse(inverse(matched) + known)
        self._advance(pose, prior, time, np.eye(3) - covariance @ known, matched)
        if self._motion.lost:
            self._drift.halt()
        self._lost = 0.0
        self._pose = self._motion.follow(pose, time, free if share < 1.0 else None, 1.0 if prior.change is None else share,
                                         registration.rotation_unobservable, p)
        moved = frame.pose.inverse() @ pose
        due = self._is_due(frame, moved, registration)
        new = not due and angle is not None and correspondences is not None and sees_new_surface(features, pose, correspondences, angle, p)
        here = KeyFrame(features, pose, share >= _KNOWN and not registration.rotation_unobservable, self._number)
        if due or new:
            size = p.odometry.key_frames if p.odometry.reference == 'window' else 1
            self._window = self._window.with_frame(here, size, latest=due)
        self._found = None if due or new else here
        if (due or new) and registration.status is Status.OK:
            self._straighten(features.segments)
        if due:
            self._drift.anchor()
        reported = self._rest.update(self._pose, covariance, time.interval, p.odometry.zero_velocity_gate)
        return self._update(features, registration.status, time, reported, registration, frame, due or new)

    def _advance(self, pose, prior, time, *found):
        """Carry the covariances on to the new `pose`; `found` is what a match adds to `CovariancePropagation.advance`."""
        step = self._pose.inverse() @ pose
        self._walls.travel(step)
        self._drift.advance(step, time.interval, prior, *found)
        if time.gap:
            # Mostly the stamp is wrong, and the motion goes on; but nothing is known of how fast.
            self._drift.halt()

    def _straighten(self, segments):
        """Turn the heading to what the walls say of it."""
        p = self.parameters.manhattan
        if p.heading_drift:
            pose = self._straight @ self._pose
            turn, share = self._walls.observe(segments, pose.theta, p)
            self._straight = SE2(pose.x, pose.y, pose.theta + turn) @ self._pose.inverse()
            self._drift.reduce_heading_variance(share)

    def _is_due(self, frame, moved, registration):
        p = self.parameters.odometry
        return (p.reference == 'previous' or frame is not self._window.latest
                or math.hypot(moved.x, moved.y) > p.key_frame_distance or abs(moved.theta) > p.key_frame_angle
                or registration.overlap < p.key_frame_overlap)

    def _coast(self, features, registration, expected):
        """The scan is not found: go on as expected for a while, then as told or not at all, then restart."""
        p, (pose, prior, _, own, time) = self.parameters.odometry, expected
        self._lost += max(time.interval, time.elapsed)
        if self._lost > p.restart_time or time.jump:
            if expected.told:
                self._pose = pose
            return self._start(features, time.jump or f'lost for {self._lost:.1f} s')
        if self._lost > p.coast_time:
            if self._motion.has_velocity:
                # Once: what is not known of the twist lasts.
                self._halt()
            if prior is own:
                pose = self._pose
        self._firm = 0.0
        self._advance(pose, prior, time)
        self._pose = pose
        self._motion.coast(pose, time.half)
        status = Status.AMBIGUOUS if registration.status is not Status.FAILED else Status.FAILED
        return self._update(features, status, time, self._pose, registration, self._window.latest, False)

    def _start(self, features, reason):
        """Start, or restart for a `reason`, at the pose reached so far; nothing is known of the motion."""
        self._forget()
        if reason:
            self._drift.unknown_motion_covariance()
        self._window = KeyFrameWindow((KeyFrame(features, self._pose, number=self._number),))
        status = Status.FAILED if reason else Status.OK
        return self._update(features, status, ScanInterval(jump=reason), self._pose, None, None, True)

    def _update(self, features, status, time, pose, registration, frame, changed):
        pose = self._straight @ pose
        step, self._reported = self._reported.inverse() @ pose, pose
        number, self._number = self._number, self._number + 1
        return OdometryUpdate(
            features.scan.stamp, pose, turned(self._drift.pose, pose.theta) + _LEAST_COVARIANCE, self._motion.twist.copy(),
            self._drift.twist + _LEAST_COVARIANCE, time.interval, step, status, registration, features,
            frame and frame.features, self._straight @ frame.pose if frame else pose, changed, time.jump, self._systematic.slope.copy(),
            number, frame.number if frame else None)


class _Expected(NamedTuple):
    """What is expected of a scan: its pose by a prior, and by the odometry's own."""

    pose: SE2
    prior: Prior
    usual: SE2
    own: Prior
    time: ScanInterval

    @property
    def told(self):
        """Whether somebody has told the whole motion."""
        return _is_told(self.prior, self.own)


class _Found(NamedTuple):
    """Where a scan was found: the key frame, None when no result can be trusted, and the scan without what moves."""

    frame: KeyFrame | None
    pose: SE2 | None
    registration: Registration
    features: Features | None


_GLIMMER = 0.3
"""Share of the least score from which on a place is worth a second look."""
_QUARTER = 0.5 * math.pi
"""A motion whose prior rules out no turn as far as this [rad] is vaguely expected."""
_KNOWN = 0.2
"""Share of `decision.min_information` that has to hold a scan along every direction, so that its place is known."""
_DOUBTFUL = 0.7
"""Share of `prior.gate` within which a doubtful scan is believed after a motion of which nothing is known."""
# Never published as exactly known: 1 mm, 0.06 deg.
_LEAST_COVARIANCE = np.diag([1e-6, 1e-6, 1e-6])


def _is_told(prior, own):
    """Whether somebody has told the whole motion."""
    return prior is not own and prior.change is None


def _half(scan, features, share):
    """The time [s] from the stamp of a scan to the middle of its returns, when it took that share of the time it is said to take."""
    return share * scan.time_increment * float(features.beams.mean())


def _level(frame, registration, expected, angle):
    """Where a scan lies that is registered to a key frame, and the direction [rad] that this leaves free: `angle` if it leaves none.

    Along that direction it is level with what is `expected`.
    """
    pose = frame.pose @ registration.transform
    if registration.degenerate_direction is None:
        return pose, angle
    angle = frame.pose.theta + registration.degenerate_direction
    return _slide(pose, expected, angle), angle


def _slide(pose, target, direction):
    """`pose` moved along `direction` [rad] until it is level with `target`."""
    c, s = math.cos(direction), math.sin(direction)
    way = c * (target.x - pose.x) + s * (target.y - pose.y)
    return SE2(pose.x + way * c, pose.y + way * s, pose.theta)
