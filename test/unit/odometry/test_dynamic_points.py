# SPDX-License-Identifier: Apache-2.0
"""Dynamic points lie in the free space of key frames; points that were occluded, or behind walls, do not."""
import dataclasses
import math

import numpy as np
import pytest
from rooms import FULL, HALF, L_ROOM, look, outline, with_person

from dbscan_reg_ros import SE2, Odometry, Parameters
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.mapping.dynamic_points import (
    detached_points,
    dynamic_points,
    without_dynamic_points,
)
from dbscan_reg_ros.core.mapping.key_frame import KeyFrame
from dbscan_reg_ros.core.mapping.key_frame_window import KeyFrameWindow
from dbscan_reg_ros.core.sensor import Sensor

HERE, THERE = SE2(-0.6, 0.3, 0.3), SE2(-0.8, 0.2, 0.1)


def seen_from(pose, scan=None):
    return KeyFrame(extract_features(scan or look(outline(L_ROOM), pose, FULL)), pose)


def moving_beams(scan, frames, pose=THERE, margin=0.2, movable=()):
    """The beams of dynamic points; those of `movable` beams do not show that the pose is wrong."""
    features = extract_features(scan)
    beams = features.beams[features.normals.any(axis=1)]
    moving = dynamic_points(features.oriented_points, pose, KeyFrameWindow(frames), len(frames), margin,
                            ~np.isin(beams, movable))
    return set(beams[moving].tolist())


def test_no_point_of_a_room_is_dynamic():
    assert not moving_beams(look(outline(L_ROOM), THERE, FULL), [seen_from(HERE)])


def test_a_person_is_found_and_nothing_else():
    scan, hidden = with_person(look(outline(L_ROOM), THERE, FULL), 0.4)
    found = moving_beams(scan, [seen_from(HERE)])
    assert found <= set(np.flatnonzero(hidden).tolist()) and len(found) >= 0.8 * np.count_nonzero(hidden)


def test_a_person_who_overlaps_their_old_position_is_dynamic_as_a_whole():
    """The person has moved by half their width: the other half lies where they hid the room before."""
    room = look(outline(L_ROOM), THERE, FULL)
    before, now = (with_person(room, bearing)[0] for bearing in (0.4, 0.65))
    hidden = with_person(room, 0.65)[1]
    found = moving_beams(now, [seen_from(THERE, before)])
    assert len(found) >= 0.8 * np.count_nonzero(hidden)


def test_a_person_by_a_long_wall_is_found_without_the_wall():
    """Person and wall are one run of points: nearly half of the scan, a good part of it in free space.

    The person is a sixth.
    """
    walls = [[(1.2, -1.0), (1.2, 1.0)], [(-5.0, 3.0), (5.0, 3.0)], [(5.0, -3.0), (-5.0, -3.0)]]
    room = look(np.array(walls), geometry=HALF)
    scan, hidden = with_person(room, 0.0)
    found = moving_beams(scan, [seen_from(SE2(), room)], SE2(), margin=0.35)
    assert found <= set(np.flatnonzero(hidden).tolist()) and len(found) >= 0.8 * np.count_nonzero(hidden)


def test_a_person_at_rest_is_not_dynamic():
    room = look(outline(L_ROOM), THERE, FULL)
    scan, _ = with_person(room, 0.4)
    assert not moving_beams(scan, [seen_from(THERE, scan)])
    assert moving_beams(scan, [seen_from(THERE, scan), seen_from(HERE)])


def test_what_a_lidar_at_another_height_does_not_see_is_not_dynamic():
    """The lower lidar sees an object over which the higher one sees."""
    room = look(outline(L_ROOM), THERE, FULL)
    low, _ = with_person(room, 0.4)
    frames = [dataclasses.replace(seen_from(*seen), sensor=Sensor(name))
              for name, seen in (('low', (THERE, low)), ('high', (HERE,)), ('high', (THERE, room)))]
    features, window = extract_features(low), KeyFrameWindow(frames)

    def static(sensor):
        return without_dynamic_points(features, THERE, window, Parameters(), sensor)
    assert static('low').normals is features.normals
    assert len(static('high').oriented_points) < len(features.oriented_points)


def test_if_most_points_would_be_dynamic_none_are():
    scan = look(outline(L_ROOM), THERE, FULL)
    assert not moving_beams(scan, [seen_from(HERE)], THERE @ SE2(0.0, 0.0, 1.2))


def test_many_people_in_free_space_do_not_show_that_the_pose_is_wrong():
    """Six people hide half of a room: as movable objects they do not show that the pose is wrong."""
    scan = look(outline(L_ROOM), THERE, FULL)
    hidden = np.zeros(len(scan.ranges), dtype=bool)
    for bearing in np.arange(6) * math.pi / 3.0:
        scan, theirs = with_person(scan, bearing)
        hidden |= theirs
    people, frames = np.flatnonzero(hidden), [seen_from(HERE)]
    assert not moving_beams(scan, frames)
    found = moving_beams(scan, frames, movable=people)
    assert found <= set(people.tolist()) and len(found) >= 0.8 * len(people)
    # Where every object is movable, all of them are judged.
    assert not moving_beams(scan, frames, movable=np.arange(len(hidden)))


@pytest.mark.parametrize('bearing', [0.4, 3.13, -3.13])
def test_small_detached_objects_are_movable_and_walls_are_not(bearing):
    """A person is movable, also across the first beam; not if only smaller objects are."""
    scan, hidden = with_person(look(outline(L_ROOM), THERE, FULL, noise=0.0), bearing)
    features = extract_features(scan)
    cloud, theirs = features.oriented_points, hidden[features.beams[features.normals.any(axis=1)]]
    free = detached_points(cloud, 1.1, 0.2, closed=True)
    assert 20 < np.count_nonzero(theirs) < np.count_nonzero(free) + 5 and theirs[free > 0].all()
    assert (free[free > 0] == np.count_nonzero(free)).all()
    assert not detached_points(cloud, 0.3, 0.2, closed=True).any()
    assert not detached_points(cloud.select(~theirs), 1.1, 10.0, closed=True).any()


def test_an_object_weighs_no_more_the_more_points_show_it():
    """All points of a person together weigh as half a point of a wall."""
    scan, _ = with_person(look(outline(L_ROOM), THERE, FULL, noise=0.0), 0.4)
    features = extract_features(scan)
    detached = detached_points(features.oriented_points, 1.1, 0.2, closed=True) > 0
    window = KeyFrameWindow((KeyFrame(features, SE2()),))
    every = dataclasses.replace(Parameters(), odometry=dataclasses.replace(
        Parameters().odometry, movable_information_ratio=0.0))
    weights = without_dynamic_points(features, SE2(), window, every).oriented_points.weights
    assert np.count_nonzero(detached) > 20 and weights[detached].sum() == pytest.approx(0.5)


def test_with_an_imprecise_prediction_no_point_is_dynamic():
    """The prior is no better than the margin: a person stays in."""
    room = look(outline(L_ROOM), THERE, FULL)
    scans = [room, with_person(dataclasses.replace(room, stamp=100_000_000), 0.4)[0]]
    for spread, left in ((0.15, False), (0.25, True)):
        odometry = Odometry(Parameters().replace({'advanced.prior.min_sigma': spread, 'advanced.time.max_jump': 100.0}))
        odometry.process(scans[0])
        last = odometry.process(scans[1]).features
        assert (len(last.oriented_points) == len(extract_features(scans[1]).oriented_points)) == left
