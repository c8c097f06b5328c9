# SPDX-License-Identifier: Apache-2.0
"""The local map: what it takes of older key frames, and what that is good for."""
import dataclasses

import numpy as np
import pytest
from rooms import FULL, look, outline

from dbscan_reg_ros import SE2
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.mapping.key_frame import KeyFrame
from dbscan_reg_ros.core.mapping.key_frame_window import KeyFrameWindow
from dbscan_reg_ros.core.sensor import Sensor

ROOM = outline([(-4.0, -3.0), (4.0, -3.0), (4.0, 3.0), (-4.0, 3.0)])
BOX = outline([(1.0, -0.5), (1.0, 0.5), (1.4, 0.5), (1.4, -0.5)])
HERE, BEFORE = SE2(), SE2(-0.5, 0.4, 0.3)


def key_frame(pose, *things, constrained=True):
    return KeyFrame(extract_features(look(np.concatenate((ROOM, *things)), pose, FULL, noise=0.0)), pose, constrained)


def around(*frames):
    """The points that older key frames add to the map, in the frame of the last."""
    found = KeyFrameWindow(frames).local_map_of('').map_points
    return np.zeros(0) if found is None else found.points


def test_the_local_map_keeps_walls_occluded_from_the_last_key_frame():
    """A box hides a part of the wall at x = 4; before it was not there."""
    points = around(key_frame(BEFORE), key_frame(HERE, BOX))
    hidden = points[(points.real > 1.5) & (np.abs(points.imag) < 1.0)]
    assert len(hidden) > 10 and hidden.real == pytest.approx(4.0, abs=1e-6)


def test_removed_objects_are_not_in_the_local_map():
    points = around(key_frame(BEFORE, BOX), key_frame(HERE))
    assert not ((points.real > 0.9) & (points.real < 1.5) & (np.abs(points.imag) < 0.6)).any()


def test_a_key_frame_whose_place_is_not_known_has_no_part():
    old, unknown, last = key_frame(BEFORE), key_frame(BEFORE, constrained=False), key_frame(HERE, BOX)
    assert len(around(old, last)) > 0
    assert KeyFrameWindow([unknown, last]).local_map_of('') is last.features


def test_a_key_frame_of_another_sensor_does_not_renew_the_local_map():
    front, rear = Sensor('front'), Sensor('rear', rank=1)
    frames = [dataclasses.replace(key_frame(pose), sensor=sensor)
              for pose, sensor in ((BEFORE, front), (HERE, rear), (HERE, front), (BEFORE, rear))]
    window = KeyFrameWindow(frames[:3])
    map_of_front, map_of_rear = window.local_map_of('front'), window.local_map_of('rear')
    window = window.with_frame(frames[3], 10)
    assert window.local_map_of('front') is map_of_front and window.local_map_of('rear') is not map_of_rear
    # A scan that is inserted before the latest key frame of its sensor completes the map of this sensor.
    inserted = dataclasses.replace(key_frame(BEFORE, BOX), sensor=front)
    completed = window.with_frame(inserted, 10, latest=False)
    assert completed.frames_of('front')[-1] is frames[2] and completed.local_map_of('front') is not map_of_front
    assert completed.local_map_of('rear') is window.local_map_of('rear')
