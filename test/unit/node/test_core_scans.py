# SPDX-License-Identifier: Apache-2.0
"""Which scans the node uses and answers, and what it says of the others; without DDS."""
import array
import itertools
import math

import numpy as np
import pytest
import rclpy  # noqa: F401 - needs ROS
from bags import needs_rosbags, write_bag
from core_stand_in import stamps, values
from rclpy.serialization import serialize_message
from ros_helpers import changed, distances, pose_of, restamped

from dbscan_reg_ros import SE2
from dbscan_reg_ros.node.interfaces.messages import scan_to_message
from dbscan_reg_ros.recordings import open_recording

SECOND = 1_000_000_000


def test_a_revolution_in_several_messages_is_assembled_and_reported(start_core, scans, truth):
    robot, geometry, kept = start_core(), scans[0].geometry, scans[:8]
    size, step = geometry.size // 12, (kept[1].stamp - kept[0].stamp) // 12
    robot.receive('/scan', *(
        changed(scan, angle_min=geometry.angle_min + k * size * geometry.angle_increment,
                ranges=scan.ranges[k * size:(k + 1) * size].tolist(),
                header=scan_to_message(restamped([scan], [scan.stamp + k * step])[0]).header)
        for scan in kept for k in range(12)))
    # The revolutions begin with the second sector.
    found = robot.sent('/odom')[-7:]
    assert stamps(found) == [scan.stamp + step for scan in kept[:7]]
    assert distances(found, truth[:7]).max() < 0.05
    assert '/scan: a revolution comes in up to' in robot.log


def test_every_nth_scan_is_used(start_core, scans, truth):
    answers = start_core(input__every_nth=4).play(scans[:40])
    assert [k for k, message in enumerate(answers) if message] == list(range(0, 40, 4))
    assert distances(filter(None, answers), truth[0:40:4]).max() < 0.1


def test_all_scans_of_a_burst_are_used(start_core, scans, truth):
    robot = start_core()
    for begin in range(0, 75, 25):
        robot.burst('/scan', scans[begin:begin + 25])
        assert len(robot.sent('/odom')) == begin + 25
    assert distances(robot.sent('/odom'), truth[:75]).max() < 0.1


def test_of_scans_that_come_too_fast_the_newest_win_and_the_others_are_counted(start_core, scans):
    """Their stamps are 0.1 ms apart, they come each 10 ms, and each fourth time one callback is executed."""
    robot = start_core()
    fast = restamped(scans, scans[0].stamp + 100_000 * np.arange(len(scans)))
    for k, scan in enumerate(fast):
        robot.node.deliver('/scan', scan_to_message(scan))
        robot.node.steady += 0.01
        if k % 4 == 0:
            robot.node.step()
    robot.node.spin()
    found = stamps(robot.sent('/odom'))
    assert found == sorted(found) and found[-1] == fast[-1].stamp
    status = robot.diagnosis()
    dropped = 80 - len(found)
    assert dropped > 20
    assert [values(status)[f'scans {kind}'] for kind in ('received', 'processed', 'dropped')] == [
        '80', str(len(found)), str(dropped)]
    assert f'too slow: {dropped} scans dropped' in status.message and status.level == status.WARN
    assert robot.log.count(f'too slow: {dropped} scans dropped') == 1
    assert 'too slow' not in robot.diagnosis().message


def lost(scans, moment, rng):
    return list(itertools.compress(scans, (rng.random(len(scans)) < 0.5) | (np.arange(len(scans)) < moment)))


def twice_and_three_times(scans, moment, rng):
    times = rng.integers(1, 4, len(scans))
    return [scan for k, scan in enumerate(scans) for _ in range(times[k] if k > moment else 1)]


def overtaking(scans, moment, rng):
    later = [k for start in range(moment, len(scans), 3) for k in rng.permutation(range(len(scans))[start:start + 3])]
    return [*scans[:moment], *(scans[k] for k in later)]


@pytest.mark.parametrize('disorder', [lost, twice_and_three_times, overtaking])
def test_scans_are_lost_come_again_or_overtake_each_other(start_core, scans, steady, moment, disorder):
    disordered = disorder(scans, moment, np.random.default_rng(moment))
    answers = start_core().play(disordered)
    assert all(answers)
    steady(answers)


def test_a_looped_recording_restarts_the_odometry_with_each_loop(start_core, scans, truth, tf_type):
    """Stamps that go back by seconds are a recording that starts again: a transform is sent for each scan of it."""
    robot = start_core()
    for number in 1, 2:
        robot.receive('/scan', *scans[:50])
        answers = robot.sent('/odom')[-50:]
        assert stamps(answers) == [scan.stamp for scan in scans[:50]] and pose_of(answers[0]) == SE2()
        assert distances(answers, truth[:50]).max() < 0.05
        assert len(robot.sent('/tf')) == len(robot.sent('/odom')) == 50 * number
    assert robot.log.count('odometry reset: the stamps of the scans start again') == 1
    assert 'tracking restarted' not in robot.log


def test_a_single_scan_with_a_wrong_stamp_does_not_restart_the_odometry(start_core, scans, truth):
    """One far back is skipped with the reason; one far ahead is used."""
    robot = start_core()
    wrong = restamped(scans[30:31], [scans[30].stamp - 1000 * SECOND])
    answers = robot.play([*scans[:30], *wrong, *scans[31:40]])
    assert [k for k, message in enumerate(answers) if message is None] == [30]
    assert distances(answers[31:], truth[31:40]).max() < 0.05
    assert robot.log.count('scan skipped: its stamp lies far before those of the scans around it') == 1
    assert all(robot.play(restamped(scans[40:41], [2_100_000_000 * SECOND])))
    assert distances(robot.play(scans[41:50]), truth[41:50]).max() < 0.3
    assert 'odometry reset' not in robot.log


def warnings(robot):
    """What the node has warned of, but for what becomes of the scans."""
    return [text for text in robot.node.said if not text.startswith(('scan ', 'odometry ', 'ready: '))]


@needs_rosbags
def test_the_node_warns_about_scans_as_about_their_recording(start_core, scans, tmp_path):
    millimetres = [changed(scan, ranges=array.array('f', 1000.0 * scan.ranges)) for scan in scans[:21]]
    bag = write_bag(tmp_path / 'bag', [('/scan', scan.stamp, bytes(serialize_message(message)))
                                       for scan, message in zip(scans, millimetres, strict=False)])
    [text] = [sighting.warning.text for sighting in open_recording(bag).look_through().sightings]
    robot = start_core()
    robot.receive('/scan', *millimetres)
    status = robot.diagnosis()
    assert text in status.message and status.level in (status.WARN, status.ERROR)
    assert warnings(robot) == [text]


BAD = {
    'no valid return': (lambda s: changed(s, ranges=array.array('f', [math.inf] * s.geometry.size)), 'return'),
    'nan angle': (lambda s: changed(s, angle_min=math.nan), 'angle_min nan'),
    'infinite increment': (lambda s: changed(s, angle_increment=math.inf), 'must be finite'),
    'zero increment': (lambda s: changed(s, angle_increment=0.0), 'angle_increment is 0'),
    'no beams': (lambda s: changed(s, beams=0), 'a scan of 0 beams'),
    'round and round': (lambda s: changed(s, angle_increment=1.0), 'go round more than twice'),
}


def test_bad_scans_are_named_and_skipped_and_the_next_good_one_goes_on(start_core, scans, truth):
    """A hundred of one kind fill the log with two lines, the last of which counts the others."""
    robot = start_core()
    robot.play(scans[:3])
    for k, (make, complaint) in enumerate(BAD.values()):
        robot.node.wait(10.0)
        said, good = len(robot.node.said), slice(3 * k + 4, 3 * k + 6)
        assert robot.play([make(scans[3 * k + 3])]) == [None]
        assert any(text.startswith('scan skipped: ') and complaint in text for text in robot.node.said[said:])
        assert distances(robot.play(scans[good]), truth[good]).max() < 0.05
    assert values(robot.diagnosis())['scans skipped'] == str(len(BAD))
    robot.node.wait(10.0)
    said, bad = len(robot.node.said), BAD['zero increment'][0](scans[21])
    robot.receive('/scan', *[bad] * 100)
    robot.node.wait(10.0)
    robot.receive('/scan', bad)
    complaints = [text for text in robot.node.said[said:] if 'angle_increment is 0' in text]
    assert len(complaints) == 2 and complaints[1].endswith('(99 more like this since the last time)')
    assert all(robot.play(scans[22:24]))
