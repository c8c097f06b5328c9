"""Laser odometry: keeps key frames, registers every scan to them and integrates the pose."""
import cmath
import copy
import dataclasses
import math
from functools import partial

import numpy as np

from .alignment import NO_STEP, kernel, normal_equations, shared_information
from .decision import (
    doubted,
    firmness,
    judge,
    match_covariance,
    match_segments,
    motion_along,
    motion_around,
    own_derivatives,
)
from .deskew import deskew
from .drift import Drift
from .features import extract_features
from .moving import beside, detached, held_share, outweighed
from .parameters import Parameters
from .posts import with_posts
from .range_noise import UsualShare
from .records import OdometryUpdate, Prior, Registration, Status
from .registration import register
from .rest import Rest
from .scan import Scan
from .se2 import SE2, turned
from .symmetric import inverse, mahalanobis
from .systematic import SystematicError
from .timing import Interval, Intervals
from .window import KeyFrame, Window, align


class Odometry:
    """Poses from a stream of scans.

    Parameters
    ----------
    parameters : Parameters
        May be replaced at any time; a new value counts from the next scan on, what key frames hold stays as it is.
    """

    def __init__(self, parameters: Parameters = Parameters()):
        self.parameters = parameters
        self.reset()

    @property
    def parameters(self):
        return self._parameters

    @parameters.setter
    def parameters(self, parameters):
        self._parameters = self._search = parameters
        if parameters.odometry.reference == 'window':
            # The window has the last word on the pose.
            less = dataclasses.replace(parameters.refinement, polish=0)
            self._search = dataclasses.replace(parameters, refinement=less)

    def reset(self, pose: SE2 = SE2()):
        """Forget everything; the next scan starts anew at `pose`."""
        self._pose, self._reported, self._drift = pose, pose, Drift()
        self._window, self._systematic = None, SystematicError()
        self._intervals, self._scan_lasts = Intervals(), 0.0
        self._noise_share = UsualShare()
        self._forget()

    def _forget(self):
        """Know nothing of the motion."""
        self._halt()
        self._middle, self._lost, self._pending, self._near, self._fresh = self._pose, 0.0, None, True, True
        self._held, self._since, self._free = self._pose, 0.0, None
        self._firm, self._found = 0.0, None
        self._rest = Rest(self._pose)

    def _halt(self):
        """Expect no motion."""
        self._step, self._twist, self._velocities = SE2(), np.zeros(3), []
        self._drift.halt()

    def process(self, scan: Scan, prior: Prior | None = None) -> OdometryUpdate:
        """Register `scan` and say where the sensor is.

        Parameters
        ----------
        scan : Scan
        prior : Prior, optional
            The sensor's motion since the last scan, from elsewhere (wheels, a gyroscope). What is wrong with whole motions
            time and again is learned (`prior.memory`). Without a prior the last motion is expected to go on, unless
            `odometry.prior` says otherwise.

        Raises
        ------
        ScanError
            When the scan holds too few returns to be used; the state is unchanged.
        """
        p = self.parameters
        lasts = abs(scan.time_increment) * scan.geometry.size if p.odometry.deskew else 0.0
        lasts = self._scan_lasts = lasts if lasts < p.time.jump else 0.0
        skewed = lasts and not self._intervals.jumps(scan.stamp, p.time)
        share = self._intervals.share(lasts)
        features = self._features(scan, share * self._twist) if skewed else self._features(scan)
        half = _half(scan, features, share) if lasts else 0.0
        time = self._intervals.next(scan.stamp, half, p.time, lasts)
        if self._window is None or time.jump.startswith('stamps'):
            return self._start(features, time.jump)
        if time.jump:
            self._halt()
        self._since += time.interval
        own = self._own_prior(time)
        given = prior or own
        told = _is_told(given, own)
        prior = self._systematic.corrected(given) if told else given
        expected = self._pose @ prior.transform
        frame, pose, registration, standing = self._register(features, expected, prior, own, time)
        if skewed and frame is not None and self._drives_off(pose, registration, time):
            features, time = self._begin_moving(scan, pose, time, self._intervals.share(lasts))
            frame, pose, registration, standing = self._register(features, expected, prior, own, time)
        self._fresh = False
        if frame is None:
            return self._coast(features, registration, expected, prior, own, time)
        before, firm = self._pose, self._firm
        update = self._follow(standing, frame, pose, registration, expected, prior, own, time)
        self._firm = firmness(registration, p.decision) if update.status is Status.OK else 0.0
        if told and not time.gap and self._agrees(self._pose, expected, given.covariance):
            self._learn(given, before.inverse() @ self._pose, min(firm, self._firm))
        return update

    def expected_motion(self, stamp) -> Prior | None:
        """What is expected of the motion to a scan at `stamp` [ns] when nobody tells of it; None before the first scan."""
        if self._window is None:
            return None
        return self._own_prior(copy.deepcopy(self._intervals).next(stamp, 0.0, self.parameters.time, self._scan_lasts))

    def _features(self, scan, twist=(0.0, 0.0, 0.0), again=False):
        """Of a scan, looked at for the first time or `again`, without the motion within it, at a `twist` [m/s, m/s, rad/s]."""
        p = self.parameters
        features = extract_features(deskew(scan, twist), p)
        if not again:
            self._noise_share.add(features.noise_share)
        share = self._noise_share.value
        if share != features.noise_share:
            features = dataclasses.replace(features, noise_share=share)
        return with_posts(features, p.odometry.post_size, p.segments) if p.odometry.post_size else features

    def _drives_off(self, pose, registration, time):
        """Whether the scan after a start, found at `pose`, tells of a motion, and all of it."""
        if not self._fresh or registration.status is not Status.OK or time.gap or time.interval <= 0.0:
            return False
        moved = (self._pose.inverse() @ pose).as_array()
        return mahalanobis(moved, registration.covariance) > self.parameters.odometry.rest ** 2

    def _begin_moving(self, scan, pose, time, share):
        """Start anew, now that the motion is known: it is taken out of the first scan, and of the next, found at `pose`.

        Returns the features and the time of the next.
        """
        twist = (self._pose.inverse() @ pose).as_array() / time.interval
        first, features = (self._features(each, share * twist, again=True) for each in (self._window.latest.features.scan, scan))
        time = dataclasses.replace(time, half=_half(scan, features, share))
        self._window, self._twist = Window((KeyFrame(first, self._pose),)), twist
        self._middle = self._held = self._pose @ _travel(twist, time.half)
        return features, time

    def _standing(self, features, pose):
        """The scan without what moves, and with little of what may move, if it was taken from `pose`."""
        p = self.parameters.odometry
        walls = features.walls
        movable = detached(walls, p.movable_size, p.moving_margin, features.scan.geometry.closed)
        if p.moving_frames:
            moving = self._window.sights(p.moving_frames).moving_points(features.dense_cloud, pose, p.moving_margin)
            if moving.any():
                gone = moving[:len(walls)]
                movable = (movable | beside(walls, gone, p.moving_margin))[~gone]
                features = features.without(moving)
                walls = features.walls
        movable = movable.nonzero()[0]
        if len(movable) and held_share(walls, movable) < p.movable_share:
            movable = movable[:0]
        if features.posts:
            movable = np.concatenate((movable, np.arange(len(walls), len(features.dense_cloud))))
        if not len(movable):
            return features
        things = features.dense_cloud.select(movable)
        seen = self._window.confirmed(pose, things, p.movable_distance, self.parameters.refinement.score_scale,
                                      self.parameters.density.facing)
        return features.doubting(movable, np.maximum(seen, outweighed(things, p.movable_size, p.moving_margin, p.movable_worth)))

    def _own_prior(self, time):
        """The last motion once more; its spread grows with the interval and with the motion itself."""
        p = self.parameters.prior
        unknown = self._step is None or self.parameters.odometry.prior == 'none'
        step = SE2() if unknown or time.jump else self._step
        if unknown or time.gap:
            return Prior(step, self._leap(time))
        if time.steady and self._velocities and not 1.0 / _ALIKE < time.interval / self._lasted < _ALIKE:
            # Scans were lost, now or before.
            step = _travel(self._usual_twist(), time.interval)
        # No turn is farther off than half of one, however long it had time: the prior still tells there from back.
        farthest = math.pi / p.limit
        faster, faster_turn = p.acceleration * time.interval ** 2, min(p.angular_acceleration * time.interval ** 2, farthest)
        sigma = math.hypot(p.least, faster, p.jitter * math.hypot(step.x, step.y))
        turn = min(math.hypot(p.least_angle, faster_turn, p.jitter * step.theta), farthest)
        return Prior(step, np.diag((sigma * sigma, sigma * sigma, turn * turn)), np.diag((faster, faster, faster_turn)) ** 2)

    def _register(self, features, expected, prior, own, time):
        """Register to the latest key frame, or where that leads nowhere to the last scan that was found, or to older key frames.

        Those are asked, too, where the latest leaves a direction free. Returns the key frame, None when no result can be
        trusted, the pose, the registration and the scan without what moves; all of it where the motion is not expected to
        better than the margin. A direction that the scans leave free is left to what was expected.
        """
        p = self.parameters
        standing = self._standing(features, expected) if prior.spread < p.odometry.moving_margin else features
        usual = self._pose @ own.transform
        vague = prior.spread > p.decision.vague or p.prior.limit * prior.angular_spread > _QUARTER
        around, usual_around = self._reach(prior, expected), self._reach(own, usual)
        told = _is_told(prior, own)
        slips = told and not self._agrees(expected, usual, own.covariance)
        first, faint, pending = None, None, self._pending
        self._pending = None
        for frame in self._references(expected):
            if frame is self._found and first.status is not Status.FAILED:
                continue
            back = frame.pose.inverse()
            guess = Prior(back @ expected, prior.covariance)
            registration, seen = self._match(frame, features, standing, guess)
            first = first or registration
            if registration.status is Status.FAILED:
                continue
            pose = frame.pose @ registration.transform
            if registration.free_direction is not None:
                angle = frame.pose.theta + registration.free_direction
                pose = _slide(pose, expected, angle)
            # A corridor looks the same to who has turned back: so far from what is vaguely expected nothing doubtful is believed.
            doubtful = registration.status is not Status.OK and vague
            share = _DOUBTFUL if doubtful else 1.0
            # A few points that speak against what was told are not believed for a while, but where wheels seem to slip.
            sure = not told or firmness(registration, p.decision) == 1.0 or self._lost > p.odometry.coast
            if (self._agrees(pose, expected, around, share) or (sure or slips)
                    and self._agrees(pose, usual, usual_around if sure else own.covariance, share)):
                found = frame, pose, registration, seen
                if registration.free_direction is None and (faint is None or registration.status is Status.OK):
                    return found
                faint = faint or found
                if registration.free_turn or self._facing(seen, pose, angle).sum() < p.decision.min_information:
                    break
            elif sure and registration.status is Status.OK and faint is None:
                # Against all that was expected: a leap is believed when the next scan says the same.
                if self._agrees(pose, usual, self._leap(time)) or (
                        pending is not None and self._agrees(pose, pending @ own.transform, own.covariance)):
                    if self._lost:
                        # From where it was only expected to be: a correction, no motion.
                        self._middle = None
                    return frame, pose, registration, seen
                self._pending = self._pending or pose
        if faint is not None:
            return faint
        if first.status is Status.FAILED and len(self._window.frames) > 1 and prior.spread < p.odometry.moving_margin:
            together = self._among_all(standing, expected)
            if together.status is not Status.FAILED:
                return self._window.latest, expected, together, standing
        return None, None, first, None

    def _learn(self, told, found, worth):
        """Learn what is wrong with a motion that was `told`, now that it is `found`."""
        memory = self.parameters.prior.memory
        if memory:
            self._systematic.learn(told, found, worth, memory)
        else:
            self._systematic = SystematicError()

    def _reach(self, prior, expected):
        """Covariance of a scan that is `expected` by a prior: along a direction that was left free it may have gone faster since.

        No farther, though, than a place along it is searched for.
        """
        if self._free is None or prior.change is None:
            return prior.covariance
        p, angle = self.parameters, self._free - expected.theta
        farther = min(0.5 * p.prior.acceleration * self._since ** 2, p.free.reach)
        along = np.array((math.cos(angle), math.sin(angle), 0.0))
        return prior.covariance + farther ** 2 * along[:, None] * along

    def _references(self, expected):
        """The latest key frame, the last scan that was found if it is none, and then the nearest of the older key frames."""
        *older, latest = self._window.frames
        yield latest
        if self._found is not None and abs((latest.pose.inverse() @ expected).theta) > self.parameters.odometry.keyframe_angle:
            yield self._found
        older.sort(key=lambda frame: math.hypot(frame.pose.x - expected.x, frame.pose.y - expected.y))
        yield from older[:self.parameters.odometry.retries]

    def _match(self, frame, features, standing, guess):
        """The scan without what moves registered to a key frame, and what was registered.

        What moves is known from where the scan was expected. Where that led nowhere, but not quite, it is known from where
        the scan seems to be.
        """
        p = self.parameters
        registration = register(frame.features, standing, self._search, guess, self._near)
        # Where scores are too low for a search near the prior to be enough they are so for a while.
        self._near = registration.score > p.prior.enough
        if registration.status is not Status.FAILED or registration.score < _GLIMMER * p.decision.min_score:
            return registration, standing
        there = self._standing(features, frame.pose @ registration.transform)
        if there.normals is standing.normals:
            return registration, standing
        return register(frame.features, there, self._search, guess), there

    def _among_all(self, features, expected):
        """The scan where it was expected, and whether the key frames together see it there where no single one does."""
        p, cloud, latest = self.parameters, features.dense_cloud, self._window.latest
        partners = self._window.partners(expected, cloud, p.density)
        # Each point as the key frame that knows it best has it: faint agreement with many is none.
        seen = np.zeros(len(cloud))
        np.maximum.at(seen, partners.index, kernel(partners.rows[3], p.refinement.score_scale))
        overlap = float(cloud.weighed(seen).sum()) / max(float(cloud.weighed(np.ones(len(cloud))).sum()), 1e-9)
        covariance, held = self._uncertainty(features, expected, partners)
        status, reason = judge(overlap, math.inf, held, p.decision)
        free = math.remainder(held.angle - latest.pose.theta, math.pi) if held.weak < p.decision.min_information else None
        transform = latest.pose.inverse() @ expected
        matches = partial(match_segments, latest.features.segments, features.segments, transform, p.decision)
        return Registration(transform, covariance, status, overlap, overlap, (), free, matches, reason, held.weak,
                            held.turn < p.decision.min_information)

    def _leap(self, time):
        """Covariance of a motion of which nothing is known."""
        p = self.parameters.prior
        lasted = min(time.elapsed if time.gap else time.interval, self.parameters.time.jump)
        sigma = math.hypot(p.unknown, 0.5 * p.acceleration * lasted ** 2)
        turn = min(math.hypot(p.unknown_angle, 0.5 * p.angular_acceleration * lasted ** 2), 1.0)
        return np.diag([sigma, sigma, turn]) ** 2

    def _agrees(self, pose, expected, covariance, share=1.0):
        """Whether the pose lies within `share` of `prior.limit` of what is expected."""
        off = (expected.inverse() @ pose).as_array()
        return mahalanobis(off, covariance) <= (share * self.parameters.prior.limit) ** 2

    def _follow(self, features, frame, pose, registration, expected, prior, own, time):
        """The scan is found: align it with the window, and make it a key frame when it is due."""
        p = self.parameters
        registration = doubted(registration, prior, p.decision)
        known, angle = np.zeros((3, 3)), None
        if registration.free_direction is not None:
            angle = frame.pose.theta + registration.free_direction
        if _is_told(prior, own):
            sharp = self._systematic.sharpened(prior)
            prior = sharp if self._agrees(pose, expected, sharp.covariance) else prior
        if self._agrees(pose, expected, prior.covariance):
            known = inverse(prior.covariance)
        if p.odometry.reference == 'window':
            scales, damping = p.refinement.window_scales(features.noise), p.refinement.damping
            strength = max(p.prior.point, features.noise) ** 2 * turned(known, expected.theta)
            around = registration.free_turn and prior is not own and known.any()
            if around:
                pose = expected
            partners = self._window.partners(pose, features.dense_cloud, p.density)
            if angle is not None or around:
                strength = self._stiffened(strength, features, pose, partners, angle, around)
            pose = align(partners, pose, expected, strength, scales[:-1], damping)
            # Points that lie close together have other partners soon, points far apart hardly.
            if len(features.dense_cloud) > p.density.points or partners.moved(pose) > _STALE * p.density.cell:
                partners = self._window.partners(pose, features.dense_cloud, p.density)
            pose = align(partners, pose, expected, strength, scales[-1:], damping)
            matched, held = self._uncertainty(features, pose, partners, angle is not None, registration.free_turn)
            free, weak = held.angle, held.weak
        else:
            matched, free, weak, partners = registration.covariance, angle, registration.weakest, None
        share = 1.0 if angle is None else min(weak / p.decision.min_information, 1.0)
        covariance = inverse(inverse(matched) + known)
        self._advance(pose, prior, time, np.eye(3) - covariance @ known, matched)
        self._take(pose, time, free if share < 1.0 else None, 1.0 if prior.change is None else share, registration.free_turn)
        moved = frame.pose.inverse() @ pose
        due = self._is_due(frame, moved, registration)
        new = not due and angle is not None and partners is not None and self._sees_more(features, pose, partners, angle)
        found = KeyFrame(features, pose)
        if due or new:
            size = p.odometry.window if p.odometry.reference == 'window' else 1
            self._window = self._window.with_frame(found, size, latest=due)
        self._found = None if due or new else found
        if due:
            self._drift.anchor()
        reported = self._rest.settle(self._pose, covariance, time.interval, p.odometry.rest)
        return self._update(features, registration.status, time, reported, registration, frame, due or new)

    def _advance(self, pose, prior, time, *found):
        """Carry the covariances on to the new `pose`; `found` is what a match adds to `Drift.advance`."""
        self._drift.advance(self._pose.inverse() @ pose, time.interval, prior, *found)
        if time.gap:
            # Mostly the stamp is wrong, and the motion goes on; but nothing is known of how fast.
            self._drift.halt()

    def _take(self, pose, time, free, share, turns):
        """Go on to where the scan was found.

        The points lie where the twist of the scan before carried them. An error of that twist turns into one of the pose
        at the stamp, not of the pose in the middle of the scan: the new twist comes from the middles. Where the scan before
        was found nowhere no motion is known. Along a direction that the scan leaves `free` [rad] the speed stays as it was, but
        for a `share`. Once a scan holds that direction again the speed follows from the way since one did so last. Where the
        scan `turns` freely, too, what is free is a way with a turn: no speed along one direction stays.
        """
        if turns:
            free = self._free = None
        middle = pose @ _travel(self._twist, time.half)
        before, self._middle = self._middle, middle
        if before is None:
            self._halt()
            self._step = None
        elif time.interval > 0.0 and time.elapsed > 0.0 and not time.gap:
            usual = self._usual_twist()
            self._twist = (before.inverse() @ middle).as_array() / time.interval
            if free is not None:
                self._set_speed(usual[:2], free - middle.theta, 1.0 - share)
            elif self._free is not None:
                back = (middle.inverse() @ self._held).as_array()
                faster = -back[:2] / self._since - usual[:2]
                self._set_speed(usual[:2] + _WANDERS * faster, self._free - middle.theta)
            self._velocities = [*self._velocities, self._twist[:2]][-self.parameters.prior.velocities:]
            self._step, self._lasted = _travel(self._usual_twist(), time.interval), time.interval
        if free is None:
            self._held, self._since = middle, 0.0
        self._free = free
        self._pose, self._lost = middle @ _travel(self._twist, time.half).inverse(), 0.0

    def _set_speed(self, velocity, angle, share=1.0):
        """Take a `share` of the speed along `angle` [rad] from a `velocity` [m/s, m/s], both in the sensor's frame."""
        along = np.array((math.cos(angle), math.sin(angle)))
        self._twist[:2] += share * ((velocity - self._twist[:2]) @ along) * along

    def _usual_twist(self):
        """The twist that is expected to go on: the last turning rate, and the mean of the last few velocities.

        Walls always hold the rotation, but not the motion along them: a step that noise has made too long would be expected
        again, and found.
        """
        vx, vy = sum(self._velocities, np.zeros(2)) / max(len(self._velocities), 1)
        return np.array((vx, vy, self._twist[2]))

    def _facing(self, features, pose, angle):
        """``(P,)``: what each point of a scan at `pose` would hold of the motion along `angle` [rad], if it faces along it."""
        cloud = features.dense_cloud
        along = (cloud.normals * cmath.exp(1j * (pose.theta - angle))).real
        return cloud.weighed(np.where(np.abs(along) < self.parameters.free.facing, 0.0, cloud.sharpened(along) ** 2))

    def _sees_more(self, features, pose, partners, angle):
        """Whether points that no key frame knows would hold the motion along `angle` [rad], which the latest leaves free.

        They have to be most of those that face along it: noise makes a few of every wall seem to do so.
        """
        _, weight = partners.match(partners.step(pose), self.parameters.refinement.window_first_scale)
        facing = self._facing(features, pose, angle)
        new = float((1.0 - np.bincount(partners.index, weight, partners.size)) @ facing)
        return new >= max(self.parameters.decision.min_information, 0.5 * float(facing.sum()))

    def _is_due(self, frame, moved, registration):
        p = self.parameters.odometry
        return (p.reference == 'previous' or frame is not self._window.latest
                or math.hypot(moved.x, moved.y) > p.keyframe_distance or abs(moved.theta) > p.keyframe_angle
                or registration.overlap < p.keyframe_overlap)

    def _stiffened(self, strength, features, pose, partners, angle, around):
        """The `strength` of a prior, more along the free direction `angle` [rad], if any, and where the turn is free `around`.

        Most of what the points seem to know of such a motion is noise of their normals. The prior counts for as many times
        more as all their information is more than what both scans agree on.
        """
        limits = self.parameters.decision
        _, weight = partners.match(NO_STEP, self.parameters.refinement.window_first_scale)
        rows, own = partners.rows[:3], _own_derivatives(features, pose, partners)
        information, shared = normal_equations(rows, weight), shared_information(rows, weight, own)
        motions = [] if angle is None else [motion_along(angle, shared, limits)]
        if around:
            motions.append(motion_around(information, shared, limits))
        stiffened = strength
        for motion in motions:
            seeming, known = motion @ information @ motion, motion @ shared @ motion
            times = seeming / max(known, _LEAST_SHARED * seeming) if seeming > 0.0 else 1.0
            pull = strength @ motion
            stiffened = stiffened + max(times - 1.0, 0.0) / max(motion @ pull, 1e-12) * (pull[:, None] * pull)
        return stiffened

    def _uncertainty(self, features, pose, partners, free_way=False, free_turn=False):
        """Covariance of the scan's place among the key frames, in its own frame, and what holds it: `decision.match_covariance`."""
        p = self.parameters
        error, weight = partners.match(partners.step(pose), p.refinement.score_scale)
        own = _own_derivatives(features, pose, partners)
        covariance, held = match_covariance(error, weight, partners.rows[:3], own, features.noise, p.decision, free_way, free_turn)
        return turned(covariance, -pose.theta), held

    def _coast(self, features, registration, expected, prior, own, time):
        """The scan is not found: go on as expected for a while, then as told or not at all, then start anew."""
        p = self.parameters.odometry
        self._lost += max(time.interval, time.elapsed)
        if self._lost > p.give_up or time.jump:
            return self._start(features, time.jump or f'lost for {self._lost:.1f} s')
        if self._lost > p.coast:
            if self._velocities:
                # Once: what is not known of the twist lasts.
                self._halt()
            if prior is own:
                expected = self._pose
        self._firm = 0.0
        self._advance(expected, prior, time)
        self._pose, self._middle = expected, expected @ _travel(self._twist, time.half)
        status = Status.AMBIGUOUS if registration.status is not Status.FAILED else Status.FAILED
        return self._update(features, status, time, self._pose, registration, self._window.latest, False)

    def _start(self, features, reason):
        """Start at the pose reached so far: the first scan, or one after which the motion is lost for a `reason`."""
        self._forget()
        if reason:
            self._drift.leap()
        self._window = Window((KeyFrame(features, self._pose),))
        status = Status.FAILED if reason else Status.OK
        return self._update(features, status, Interval(jump=reason), self._pose, None, None, True)

    def _update(self, features, status, time, pose, registration, frame, changed):
        step, self._reported = self._reported.inverse() @ pose, pose
        return OdometryUpdate(
            features.scan.stamp, pose, turned(self._drift.pose, pose.theta) + _LEAST_COVARIANCE, self._twist.copy(),
            self._drift.twist + _LEAST_COVARIANCE, time.interval, step, status, registration, features,
            frame and frame.features, frame.pose if frame else pose, changed, time.jump, self._systematic.slope.copy())


_STALE = 0.25
"""Share of a cell of the table: a scan that has moved farther may have other partners."""
_GLIMMER = 0.3
"""Share of the least score from which on a place is worth a second look."""
_ALIKE = 1.5
"""Intervals whose ratio is less are the same but for what stamps jitter."""
_QUARTER = 0.5 * math.pi
"""A motion whose prior rules out no turn as far as this [rad] is vaguely expected."""
_DOUBTFUL = 0.7
"""Share of `prior.limit` within which a doubtful scan is believed after a motion of which nothing is known."""
_WANDERS = 1.5
"""A speed that wanders at random has changed by so many times the change of its mean: the gain of a Kalman filter."""
_LEAST_SHARED = 1e-3
"""Of the information that the points seem to have, at least so much is taken as shared."""
# Never published as exactly known: 1 mm, 0.06 deg.
_LEAST_COVARIANCE = np.diag([1e-6, 1e-6, 1e-6])


def _is_told(prior, own):
    """Whether somebody has told the whole motion."""
    return prior is not own and prior.change is None


def _own_derivatives(features, pose, partners):
    """`own_derivatives` of the scan's points, one for each of the `partners`."""
    cloud = features.dense_cloud
    return own_derivatives(cloud.sharpened(cloud.normals).take(partners.index), pose.theta, partners.arms)


def _half(scan, features, share):
    """The time [s] from the stamp of a scan to the middle of its returns, when it took that share of the time it is said to take."""
    return share * scan.time_increment * float(features.beams.mean())


def _travel(twist, time):
    """Motion [m, m, rad] at a steady `twist` [m/s, m/s, rad/s] in a `time` [s]."""
    return SE2.from_array(twist * time)


def _slide(pose, target, direction):
    """`pose` moved along `direction` [rad] until it is level with `target`."""
    c, s = math.cos(direction), math.sin(direction)
    way = c * (target.x - pose.x) + s * (target.y - pose.y)
    return SE2(pose.x + way * c, pose.y + way * s, pose.theta)
