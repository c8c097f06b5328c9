# SPDX-License-Identifier: Apache-2.0
"""State of the odometry: all that is remembered from scan to scan."""
from dataclasses import dataclass, field
from enum import Enum

from ..features.range_noise import NoiseRatioHistory
from ..geometry.se2 import SE2
from .mapping.key_frame import KeyFrame
from .mapping.key_frame_window import KeyFrameWindow
from .models.covariance import CovariancePropagation
from .models.manhattan import ManhattanHeading
from .models.motion import ConstantVelocityModel
from .models.pose_output import PoseOutput
from .models.scan_order import ScanOrder
from .models.stamps import StampFilter
from .models.wheel_calibration import WheelCalibration


class Mode(Enum):
    """How the last scan was located.

    ============ ============================================= ===============================================
    mode         meaning                                       ends when
    ============ ============================================= ===============================================
    ``STARTING`` the last scan is the first of a track         the next scan is processed
    ``TRACKING`` the last scan was found                       a scan is not found
    ``COASTING`` scans are not found: dead reckoning           one is found; after `odometry.coast_time`
    ``LOST``     not found for longer: the velocity is reset   one is found; after `odometry.restart_time`
    ============ ============================================= ===============================================
    """

    STARTING = 'starting'
    TRACKING = 'tracking'
    COASTING = 'coasting'
    LOST = 'lost'


@dataclass(frozen=True, eq=False)
class LostMap:
    """The map in which scans are not found any more, while a chain of scans may go on without it.

    Attributes
    ----------
    window : KeyFrameWindow
    pose : SE2
        Pose of the last scan that was found in it, in the odometry frame.
    covariance : CovariancePropagation
        That of this scan.
    time : float [s]
        Time since this scan.
    """

    window: KeyFrameWindow
    pose: SE2
    covariance: CovariancePropagation
    time: float


@dataclass(frozen=True, eq=False)
class Tracking:
    """How well the pose is known after a scan.

    Attributes
    ----------
    mode : Mode
    lost_time : float [s]
        Time since the last scan that was found; 0 while tracking.
    unconfirmed : SE2 or None
        Pose of the first sensor at the last scan where it lay outside every gate; the next scan may confirm it.
    search_near : bool
        Whether the last registration scored high enough for a search near the prior to suffice.
    observability : float
        How well the last scan constrained the motion, from 0 to 1.
    score : float
        Score of the last scan that was found.
    found : SE2 or None
        Pose of the first sensor at the last scan that was found, in the odometry frame; None after a start.
    last_scans : tuple of KeyFrame
        The last scan of each sensor, where it did not become a key frame; where it was not found, at its predicted
        pose.
    lost : LostMap or None
        The map that scans were lost from, until one is found in it again, or for `odometry.restart_time`.
    """

    mode: Mode = Mode.STARTING
    lost_time: float = 0.0
    unconfirmed: SE2 | None = None
    search_near: bool = True
    observability: float = 0.0
    score: float = 0.0
    found: SE2 | None = None
    last_scans: tuple[KeyFrame, ...] = ()
    lost: LostMap | None = None

    def last_scan_of(self, sensor: str) -> KeyFrame | None:
        """Return the one of `last_scans` that is of a `sensor`."""
        return next((frame for frame in self.last_scans if frame.sensor.name == sensor), None)

    def scans_with(self, sensor: str, frame: KeyFrame | None) -> tuple[KeyFrame, ...]:
        """Return `last_scans` after one more scan of a `sensor`; None where it became a key frame."""
        others = tuple(each for each in self.last_scans if each.sensor.name != sensor)
        return others if frame is None else (*others, frame)


@dataclass
class SensorState:
    """What is remembered of the scans of one sensor.

    Attributes
    ----------
    stamps : StampFilter
    noise : NoiseRatioHistory
    """

    stamps: StampFilter = field(default_factory=StampFilter)
    noise: NoiseRatioHistory = field(default_factory=NoiseRatioHistory)


@dataclass
class TrackState:
    """All that is remembered from scan to scan.

    Each field is assigned in one module only: `sensors` in `pipeline`, all others in `update`.

    Attributes
    ----------
    pose : SE2
        Pose of the first sensor at the last scan of any, in the odometry frame, without heading correction.
    motion : ConstantVelocityModel
    output : PoseOutput
        Makes the published poses.
    covariance : CovariancePropagation
    heading : ManhattanHeading
    wheels : WheelCalibration
    sensors : dict
        `SensorState` of each sensor by its name.
    order : ScanOrder
    window : KeyFrameWindow or None
        None before the first scan.
    tracking : Tracking
    """

    pose: SE2
    motion: ConstantVelocityModel
    output: PoseOutput
    covariance: CovariancePropagation = field(default_factory=CovariancePropagation)
    heading: ManhattanHeading = field(default_factory=ManhattanHeading)
    wheels: WheelCalibration = field(default_factory=WheelCalibration)
    sensors: dict[str, SensorState] = field(default_factory=dict)
    order: ScanOrder = field(default_factory=ScanOrder)
    window: KeyFrameWindow | None = None
    tracking: Tracking = field(default_factory=Tracking)

    @property
    def key_frames(self) -> KeyFrameWindow:
        """The window, after the first scan."""
        assert self.window is not None, 'a track has a key frame from its first scan on'
        return self.window
