# SPDX-License-Identifier: Apache-2.0
"""What the odometry remembers from scan to scan."""
from dataclasses import dataclass, field
from enum import Enum

from ..features.range_noise import NoiseRatioHistory
from ..geometry.se2 import SE2
from .mapping.key_frame_window import KeyFrame, KeyFrameWindow
from .models.covariance import CovariancePropagation
from .models.manhattan import ManhattanHeading
from .models.motion import ConstantVelocityModel
from .models.pose_output import PoseOutput
from .models.stamps import StampFilter
from .models.wheel_calibration import WheelCalibration


class Mode(Enum):
    """How the last scan was located.

    ============ ============================================ ========================================
    mode         meaning                                      left when
    ============ ============================================ ========================================
    ``STARTING`` the last scan is the first of a track        the next scan is processed
    ``TRACKING`` the last scan was registered                 a scan is not found
    ``COASTING`` scans are not found; dead reckoning          one is found; after `odometry.coast_time`
    ``LOST``     not found for longer; the velocity is reset  one is found; after `odometry.restart_time`
    ============ ============================================ ========================================
    """

    STARTING = 'starting'
    TRACKING = 'tracking'
    COASTING = 'coasting'
    LOST = 'lost'


@dataclass(frozen=True, eq=False)
class Tracking:
    """How well the track is known after a scan.

    Attributes
    ----------
    mode : Mode
    lost_time : float [s]
        Since the last scan that was found; 0 while tracking.
    unconfirmed : SE2 or None
        Pose of the last scan where it lay outside every gate; the next scan may confirm it.
    search_near : bool
        Whether the last registration scored high enough for a search near the prior to suffice.
    observability : float
        How well the last scan constrained the motion, from 0 to 1.
    last_scan : KeyFrame or None
        The last scan, where it was found and is no key frame.
    """

    mode: Mode = Mode.STARTING
    lost_time: float = 0.0
    unconfirmed: SE2 | None = None
    search_near: bool = True
    observability: float = 0.0
    last_scan: KeyFrame | None = None


@dataclass
class TrackState:
    """All that is remembered from scan to scan. `update` writes it; all other modules read it.

    Attributes
    ----------
    pose : SE2
        Of the sensor at the last scan in the odometry frame.
    motion : ConstantVelocityModel
    output : PoseOutput
        What poses are published.
    covariance : CovariancePropagation
    heading : ManhattanHeading
    wheels : WheelCalibration
    stamps : StampFilter
    noise : NoiseRatioHistory
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
    stamps: StampFilter = field(default_factory=StampFilter)
    noise: NoiseRatioHistory = field(default_factory=NoiseRatioHistory)
    window: KeyFrameWindow | None = None
    tracking: Tracking = field(default_factory=Tracking)
