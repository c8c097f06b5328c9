# SPDX-License-Identifier: Apache-2.0
"""State of the track, which is stored from one scan to the next."""
import copy
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from types import MappingProxyType
from typing import NamedTuple

from ..geometry.se2 import SE2
from ..mapping.key_frame import KeyFrame
from ..mapping.key_frame_window import KeyFrameWindow
from ..no_return import NoReturn
from ..parameters.odometry import OdometryParameters
from .models.beam_timing import BeamTimingSearch
from .models.manhattan import ManhattanHeading
from .models.motion import ConstantVelocityModel
from .models.noise_history import NoiseRatioHistory
from .models.pose_output import PoseOutput
from .models.propagation import CovariancePropagation
from .models.scan_order import ScanOrder
from .models.stamp_filter import StampFilter
from .models.stamps import ScanInterval
from .models.surface_agreement import SurfaceAgreement
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
    """The map to which scans cannot be registered any more; tracking may continue in a new map meanwhile.

    Attributes
    ----------
    window : KeyFrameWindow
    pose : SE2
        Pose of the last scan that was registered to this map, in the odometry frame.
    covariance : CovariancePropagation
        Covariance after the last scan that was registered to this map.
    time : float [s]
        Time since the last scan that was registered to this map, without the `gap`.
    gap : bool
        Whether no scan was found in this map after a gap.
    """

    window: KeyFrameWindow
    pose: SE2
    covariance: CovariancePropagation
    time: float
    gap: bool = False

    def longest(self, parameters: OdometryParameters) -> float:
        """Return the time [s] for which the map is kept."""
        return _GAP_TIME if self.gap else parameters.restart_time


class Tracking(NamedTuple):
    """How well the pose is known after a scan.

    Attributes
    ----------
    mode : Mode
    lost_time : float [s]
        Time since the last scan that was registered successfully; 0 while tracking.
    search_near : bool
        Whether the score of the last registration was high enough that a search near the prior suffices.
    observability : float
        How well the last scan constrained the motion, from 0 to 1.
    score : float
        Score of the last scan that was registered successfully.
    found : SE2 or None
        Pose of the first sensor at the last scan that was registered successfully, in the odometry frame; None after a
        start.
    last_scans : tuple of KeyFrame
        The last scan of each sensor, unless it became a key frame. A scan that could not be registered is stored at its
        predicted pose.
    lost : LostMap or None
        The map before tracking was lost. It is dropped when a scan is registered to it again, or after
        `odometry.restart_time`, after a gap 60 s.
    """

    mode: Mode = Mode.STARTING
    lost_time: float = 0.0
    search_near: bool = True
    observability: float = 0.0
    score: float = 0.0
    found: SE2 | None = None
    last_scans: tuple[KeyFrame, ...] = ()
    lost: LostMap | None = None

    def last_scan_of(self, sensor: str) -> KeyFrame | None:
        """Return the last scan of a `sensor` from `last_scans`; None if there is none."""
        return next((frame for frame in self.last_scans if frame.sensor.name == sensor), None)

    def scans_with(self, sensor: str, frame: KeyFrame | None) -> tuple[KeyFrame, ...]:
        """Return `last_scans` after one more scan of a `sensor`; `frame` is None if that scan became a key frame."""
        others = tuple(each for each in self.last_scans if each.sensor.name != sensor)
        return others if frame is None else (*others, frame)


@dataclass
class SensorState:
    """State stored for each sensor: what is known about its stamps, noise, surfaces, returns and beams.

    Attributes
    ----------
    stamps : StampFilter
    noise : NoiseRatioHistory
    agreement : SurfaceAgreement
    no_return : NoReturn
    timing : BeamTimingSearch
    """

    stamps: StampFilter = field(default_factory=StampFilter)
    noise: NoiseRatioHistory = field(default_factory=NoiseRatioHistory)
    agreement: SurfaceAgreement = field(default_factory=SurfaceAgreement)
    no_return: NoReturn = field(default_factory=NoReturn)
    timing: BeamTimingSearch = field(default_factory=BeamTimingSearch)


NO_SENSORS: Mapping[str, SensorState] = MappingProxyType({})


@dataclass
class TrackState:
    """What is stored of a track from one scan to the next; `Odometry` also keeps repeated scans and compared lidars.

    Each field is assigned in one module only: `sensors` in `pipeline`, all others in `update`.

    Attributes
    ----------
    pose : SE2
        Pose of the first sensor at the last scan of any sensor, in the odometry frame, without heading correction.
    motion : ConstantVelocityModel
    output : PoseOutput
        Computes the published poses.
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

    @classmethod
    def initial(cls, pose: SE2, number: int, before: Mapping[str, SensorState] = NO_SENSORS) -> 'TrackState':
        """Create the state before the first scan; that scan will be at `pose` and get this `number`.

        The timing of the beams is kept from the sensors `before`.
        """
        return cls(pose, ConstantVelocityModel(pose), PoseOutput(pose, number),
                   sensors={name: SensorState(timing=sensor.timing) for name, sensor in before.items()})

    def lost_map_after(self, interval: ScanInterval) -> LostMap | None:
        """Return the map before the loss, its time increased by an `interval`; None after the first scan of a track."""
        lost = self.tracking.lost
        if lost is None and self.tracking.mode is Mode.TRACKING:
            lost = LostMap(self.key_frames, self.pose, copy.deepcopy(self.covariance), time=0.0)
        return lost and replace(lost, time=lost.time + max(interval.length, interval.elapsed))

    @property
    def key_frames(self) -> KeyFrameWindow:
        """The window of key frames; must not be read before the first scan."""
        assert self.window is not None, 'a track has a key frame from its first scan on'
        return self.window

    def map_before_gap(self, interval: ScanInterval) -> LostMap | None:
        """Return the map before the first gap since which no scan was found in it; None if there was no gap."""
        lost = self.tracking.lost
        if lost is not None and lost.gap:
            return lost
        covariance = copy.deepcopy(self.covariance)
        return LostMap(self.key_frames, self.pose, covariance, 0.0, gap=True) if interval.jump else None


_GAP_TIME = 60.0
"""Time [s] after a gap for which scans are searched in the map before it."""
