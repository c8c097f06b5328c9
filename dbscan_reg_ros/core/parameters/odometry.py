# SPDX-License-Identifier: Apache-2.0
"""Parameters of the odometry."""


from dataclasses import dataclass

from .schema import ParameterGroup, parameter


@dataclass(frozen=True)
class PriorParameters(ParameterGroup):
    """What a prior, one hypothesis among others, is worth."""

    weight: float = parameter(0.15, 'score that a hypothesis far from the prior loses: clear evidence outweighs it', '', 0.0, 2.0)
    gate: float = parameter(4.0, 'standard deviations at which it loses all of that', '', 0.1, 100.0)
    velocity_window: int = parameter(3, 'constant velocity: the mean of so many last velocities goes on', '', 1, 1000)
    acceleration: float = parameter(1.0, 'constant velocity: spread of the next step, times the interval squared', 'm/s^2',
                                    0.0, 1000.0)
    angular_acceleration: float = parameter(4.0, 'constant velocity: the same for the rotation', 'rad/s^2', 0.0, 1000.0)
    stamp_jitter: float = parameter(0.3, 'constant velocity: spread as a share of the step, for stamps that jitter', '', 0.0, 10.0)
    min_sigma: float = parameter(0.01, 'constant velocity: least spread', 'm', 0.0001, 10.0)
    min_rotation_sigma: float = parameter(0.01, 'constant velocity: least spread of the rotation', 'rad', 0.0001, 3.2)
    point_sigma: float = parameter(0.01, 'spread of a point, when points are set against the prior; at least the range noise',
                             'm', 0.0, 10.0)
    calibration_distance: float = parameter(300.0, 'told motions: what is wrong with them time and again is learned over so long a way, a radian as '
                                     'a metre; 0: they are believed as told', 'm', 0.0, 1000000.0)
    unknown_sigma: float = parameter(0.25, 'spread of the motion when nothing is known of it', 'm', 0.001, 1000.0)
    unknown_rotation_sigma: float = parameter(0.25, 'spread of the rotation when nothing is known of it', 'rad', 0.001, 6.4)

    @property
    def enough(self):
        """No hypothesis that a prior rules out scores more than this."""
        return 1.0 - self.weight


@dataclass(frozen=True)
class OdometryParameters(ParameterGroup):
    """Reference and key frames of the odometry."""

    reference: str = parameter('window', 'what scans are registered to: previous (the last scan, the paper), keyframe (the '
                               'last key frame), window (the last key frame, then aligned with the last several)', '',
                               choices=('previous', 'keyframe', 'window'))
    prior: str = parameter('constant_velocity', 'what is expected without a prior from elsewhere: none, constant_velocity',
                           '', choices=('none', 'constant_velocity'))
    key_frames: int = parameter(40, 'key frames of the window', '', 1, 1000)
    dynamic_key_frames: int = parameter(6, 'what stands in space that one of so many latest key frames saw to be free is moving and '
                                      'left out; 0: nothing is', '', 0, 1000)
    dynamic_margin: float = parameter(0.2, 'so far in front of what they saw, where the motion is expected to better than that',
                                     'm', 0.0, 100.0)
    movable_size: float = parameter(1.1, 'what is smaller than this and has deeper space on both sides, or ends the scan, may move: '
                                    'people, mostly; 0: nothing may', 'm', 0.0, 100.0)
    movable_weight: float = parameter(0.03, 'a point of it counts so much', '', 0.0, 1.0)
    movable_information_ratio: float = parameter(0.33, 'where all such things hold less than this share of the motion in every direction '
                                     'they count in full', '', 0.0, 1.0)
    static_baseline: float = parameter(0.5, 'until a key frame from so far away or more saw it in the same place', 'm', 0.0,
                                        100.0)
    pole_size: float = parameter(0.3, 'what is smaller than this, too small to have normals, and has deeper space or nothing on both '
                                 'sides, counts as a round post, little until it is seen as above; 0: not at all', 'm', 0.0, 10.0)
    key_frame_distance: float = parameter(0.3, 'a scan this far from the last key frame becomes one', 'm', 0.0, 100.0)
    key_frame_angle: float = parameter(0.26, 'or turned by this much', 'rad', 0.0, 6.4)
    key_frame_overlap: float = parameter(0.5, 'or with less overlap', '', 0.0, 1.0)
    older_key_frames: int = parameter(2, 'older key frames that are tried when the last one leads nowhere or leaves a direction free', '', 0, 100)
    coast_time: float = parameter(1.0, 'a lost sensor is taken to move on as expected this long', 's', 0.0, 1000.0)
    restart_time: float = parameter(5.0, 'and then to stand, or to move as it is told from elsewhere; after this long a new '
                                'reference is started', 's', 0.0, 10000.0)
    zero_velocity_gate: float = parameter(5.0, 'a sensor that stays this close to where it stands, in standard deviations of a scan, has not '
                            'moved; 0: every scan is taken at its word', '', 0.0, 100.0)
    deskew: bool = parameter(True, 'take out the motion within a scan, where time_increment is given')


@dataclass(frozen=True)
class ManhattanParameters(ParameterGroup):
    """Heading by the directions that most walls of a building share, modulo a right angle."""

    heading_drift: float = parameter(0.0011, 'so much the heading drifts over a way of 1 m, and over any other with its root, a radian as a '
                                     'metre; 0: it is left as it is', 'rad', 0.0, 1.0)
    wall_sigma: float = parameter(0.012, 'walls in one place are off the directions of most by so much', 'rad', 0.0001, 1.0)
    correlation_distance: float = parameter(20.0, 'those so far away have little to do with them', 'm', 0.1, 100000.0)
    direction_sigma: float = parameter(0.035, 'walls this close to a direction are along it (one standard deviation)', 'rad', 0.001, 0.5)
    min_aligned_ratio: float = parameter(0.5, 'nothing is corrected where less than this share of the walls is', '', 0.0, 1.0)


@dataclass(frozen=True)
class TimeParameters(ParameterGroup):
    """Stamps."""

    max_jump: float = parameter(2.0, 'stamps that go back by more than this restart tracking at the last pose, and twice in a row reset the node to the origin; after a gap of more than this nothing is known of the motion', 's', 0.0, 1000000.0)
