"""Where a scan lies among several key frames, and how firmly."""
import math

import pytest
from rooms import FULL, L_ROOM, look, outline

from dbscan_reg_ros.core.features import extract_features
from dbscan_reg_ros.core.parameters import Parameters
from dbscan_reg_ros.core.placement import seen_by_all
from dbscan_reg_ros.core.records import Status
from dbscan_reg_ros.core.se2 import SE2
from dbscan_reg_ros.core.window import KeyFrame, Window

ROOM = outline(L_ROOM)
PARALLEL = outline([(-50.0, -1.0), (50.0, -1.0), (50.0, 1.2), (-50.0, 1.2)])[::2]


def test_faint_agreement_with_many_key_frames_is_none():
    """Forty times the same place, and a scan 15 cm beside it: nobody sees it there."""
    *before, features = [extract_features(look(ROOM, SE2(), FULL, 0.01, i)) for i in range(41)]
    window = Window([KeyFrame(each, SE2()) for each in before])
    assert seen_by_all(window, features, SE2(), Parameters()).status is Status.OK
    assert seen_by_all(window, features, SE2(0.1, 0.1, 0.0), Parameters()).status is Status.FAILED


def test_the_way_that_all_key_frames_leave_free_is_told_in_the_frame_of_the_latest():
    """A sensor that turns between two walls along x."""
    poses = [SE2(0.2 * k, 0.0, 0.4 + 0.3 * k) for k in range(3)]
    *before, features = [extract_features(look(PARALLEL, pose, FULL, 0.01, k)) for k, pose in enumerate(poses)]
    found = seen_by_all(Window(map(KeyFrame, before, poses)), features, poses[2], Parameters())
    assert found.status is Status.DEGENERATE
    assert math.sin(poses[1].theta + found.free_direction) == pytest.approx(0.0, abs=0.01)
