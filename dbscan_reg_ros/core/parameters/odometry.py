# SPDX-License-Identifier: Apache-2.0
"""Parameters of the odometry."""
from dataclasses import dataclass

from .schema import ParameterGroup, parameter


@dataclass(frozen=True)
class PriorParameters(ParameterGroup):
    """Prediction of the motion since the last scan, and the gate around it."""

    source: str = parameter(
        'constant_velocity', bounds=('none', 'constant_velocity'),
        help='Prediction when there is no external prior: none (every motion since the last scan is equally likely) or '
             'constant_velocity (the motion model).')
    weight: float = parameter(
        0.15, bounds=(0.0, 2.0), case='symptom: `ambiguous` in rooms with repeated structure',
        help='Largest reduction of the score of a hypothesis for its distance from the prediction. Larger values give '
             'the prediction more influence; smaller values give the scans more influence.')
    gate: float = parameter(
        4.0, bounds=(0.1, 100.0), case='symptom: the pose jumps once and is correct again',
        help='Size of the gate around the prediction, in standard deviations. Larger values accept results farther '
             'from the prediction; smaller values reject more outliers, but also sudden true motions.')
    velocity_window: int = parameter(
        3, bounds=(1, 1000), case='courses lidars, featureless',
        help='Number of past velocities whose mean the constant-velocity model predicts. Larger values give smoother '
             'predictions that follow changes of the velocity with a delay; smaller values follow changes faster, but '
             'also noise.')
    acceleration: float = parameter(
        1.0, unit='m/s^2', bounds=(0.0, 1000.0),
        help='Standard deviation of the acceleration in the constant-velocity model. Larger values widen the gate for '
             'robots that start and brake hard; smaller values tighten it.')
    angular_acceleration: float = parameter(
        4.0, unit='rad/s^2', bounds=(0.0, 1000.0),
        help='Standard deviation of the angular acceleration in the constant-velocity model. Larger values widen the '
             'gate for robots that rotate abruptly; smaller values tighten it.')
    min_sigma: float = parameter(
        0.01, unit='m', bounds=(0.0001, 10.0), case='robot that sways at rest',
        help='Lower limit of the standard deviation of the predicted translation, and [rad] of the predicted '
             'rotation. Larger values widen the gate at rest; smaller values tie slow motions closer to the '
             'prediction.')
    calibration_distance: float = parameter(
        300.0, unit='m', bounds=(0.0, 1000000.0), case='wheels with systematic errors',
        help='Distance over which the weight of a measurement fades to 1 / e in the calibration of systematic errors '
             'of an external prior; each rad of rotation adds 1 m. Larger values average for longer; smaller values '
             'follow changes sooner; 0 disables the calibration.')
    unknown_sigma: float = parameter(
        0.25, unit='m', bounds=(0.001, 1000.0), case='robot that drives when the node starts',
        help='Standard deviation of the predicted translation, and [rad] of the predicted rotation, while no velocity '
             'is known, for example after a start. Larger values search a wider area and more headings; smaller values '
             'assume a sensor that starts at rest.')

    @property
    def max_score_outside_gate(self) -> float:
        """Score that no hypothesis outside the gate can exceed."""
        return 1.0 - self.weight


@dataclass(frozen=True)
class OdometryParameters(ParameterGroup):
    """Reference, key frames, dynamic points and lost track."""

    reference: str = parameter(
        'window', bounds=('previous', 'keyframe', 'window'),
        help='Reference of a scan: previous (the last scan, as in the paper), keyframe (the latest key frame) or '
             'window (the latest key frame, then an alignment with all key frames of the window).')
    key_frames: int = parameter(
        40, bounds=(1, 1000),
        help='Number of key frames in the window. Larger values reduce the drift where the robot returns to a known '
             'place and take longer; smaller values are faster.')
    dynamic_key_frames: int = parameter(
        6, bounds=(0, 1000), case='courses leader, passers',
        help='A scan is compared with the free space of this many latest key frames to find dynamic points, which are '
             'left out. Larger values find more dynamic points and take longer; 0 disables the detection.')
    dynamic_margin: float = parameter(
        0.2, unit='m', bounds=(0.0, 100.0), case='symptom: jumps of the pose while people walk by',
        help='A point is dynamic if it lies by more than this in front of the returns of a key frame. The detection '
             'only runs if the standard deviation of the predicted translation is smaller than this. Larger values '
             'leave out fewer points; smaller values also leave out static points.')
    movable_size: float = parameter(
        2.0, unit='m', bounds=(0.0, 100.0), case='symptom: standstill or jumps of the pose beside people and vehicles',
        help='An object smaller than this is treated as movable, such as a person or a vehicle, if the ranges on both '
             'sides of it are larger, or if the scan ends there. Larger values reduce the weight of more objects; 0 '
             'treats no object as movable.')
    movable_information_ratio: float = parameter(
        0.33, bounds=(0.0, 1.0), case='courses chairs, trees',
        help='Movable objects keep full weight where they provide less than this fraction of the translational '
             'information in every direction. Larger values reduce their weight less often; smaller values do so more '
             'often.')
    pole_size: float = parameter(
        0.3, unit='m', bounds=(0.0, 10.0), case='courses chairs, trees',
        help='An object smaller than this is used as a round pole if its points have no normals, and if the ranges on '
             'both sides are larger or missing. Larger values use more objects as poles; 0 uses no poles.')
    key_frame_distance: float = parameter(
        0.3, unit='m', bounds=(0.0, 100.0), case='symptom: processing is too slow',
        help='A scan becomes a key frame if it is farther than this from the latest one. Larger values give fewer key '
             'frames and less drift, if the overlap is sufficient; smaller values give more key frames.')
    key_frame_angle: float = parameter(
        0.26, unit='rad', bounds=(0.0, 6.4), case='sensor with a narrow view',
        help='A scan becomes a key frame when its heading differs from the latest one by more than this. Larger values '
             'give fewer key frames; smaller values give more.')
    key_frame_overlap: float = parameter(
        0.5, bounds=(0.0, 1.0), case='courses narrow, lidars',
        help='A scan becomes a key frame when less than this fraction of its points overlaps the latest one. Larger '
             'values give more key frames; smaller values give fewer key frames.')
    older_key_frames: int = parameter(
        2, bounds=(0, 100), case='courses sparse, losses',
        help='Number of older key frames to which a scan is registered if the latest one gives no result or a '
             'degenerate one. Larger values register more scans and take longer; 0 tries none.')
    coast_time: float = parameter(
        1.0, unit='s', bounds=(0.0, 1000.0), case='robot that passes crowds or glass',
        help='Time for which dead reckoning continues at the last velocity while scans cannot be registered. Larger '
             'values bridge longer gaps and drift farther; smaller values assume a standstill sooner.')
    restart_time: float = parameter(
        5.0, unit='s', bounds=(0.0, 10000.0), case='robot that is carried',
        help='Time after which a track that is still lost restarts with the current scan as reference. Larger values '
             'wait longer for a scan of a known place; smaller values continue sooner, from an uncertain pose.')
    zero_velocity_gate: float = parameter(
        5.0, bounds=(0.0, 100.0), case='courses lms511, spinup',
        help='Zero-velocity update: poses within this many standard deviations of their mean are averaged after 1 s. '
             'Larger values suppress more jitter, but also very slow motions; 0 disables the update.')
    max_speed: float = parameter(
        5.0, unit='m/s', bounds=(0.01, 1000.0),
        help='Highest speed of the sensor. A result that implies a higher speed since the last registered scan is '
             'rejected, and the status is FAILED. Larger values suit fast vehicles; smaller values reject more '
             'outliers.')
    max_turn_rate: float = parameter(
        6.3, unit='rad/s', bounds=(0.01, 1000.0),
        help='Highest turn rate of the sensor. A result that implies a higher rate since the last registered scan is '
             'rejected, and the status is FAILED. Larger values suit fast rotations; smaller values reject more '
             'outliers.')
    deskew: bool = parameter(
        True, help='If true, points are corrected for the motion of the sensor during a scan, provided that the scan '
                   'states its time_increment.')

    @property
    def window_size(self) -> int:
        """Number of key frames that are kept for each sensor."""
        return self.key_frames if self.reference == 'window' else 1


@dataclass(frozen=True)
class ManhattanParameters(ParameterGroup):
    """Heading correction from the two perpendicular directions that most walls of a building share."""

    heading_drift: float = parameter(
        0.0011, unit='rad', bounds=(0.0, 1.0), case='courses intel, rooms',
        help='Standard deviation of the heading drift after 1 m; it grows with the square root of the distance, to '
             'which each rad of rotation adds 1 m. Larger values correct the heading more strongly; 0 disables the '
             'correction.')


@dataclass(frozen=True)
class TimeParameters(ParameterGroup):
    """Handling of stamps that jump."""

    max_jump: float = parameter(
        2.0, unit='s', bounds=(0.0, 1000000.0), case='driver that pauses',
        help='If the stamps of two successive scans go back by more than this, the node resets the odometry to the '
             'origin. A replay restarts at the last pose. After a longer gap than this the last velocity is predicted '
             'to decay, and a match has to be unambiguous. Larger values tolerate longer gaps; smaller values react to '
             'shorter ones.')
