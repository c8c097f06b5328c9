# SPDX-License-Identifier: Apache-2.0
"""Scans as they were measured, each in the frame of its lidar, of one lidar or several."""
from dataclasses import dataclass

from ...core.geometry.mounting import Mounting
from ...core.parameters.features import ScanParameters
from ...recordings import open_recording
from ...recordings.bags.clouds import CloudParameters
from ...recordings.recording import Recording
from ...robot.parameters import NodeParameters
from ..lidars import lidars_of
from ..sensor_mounting import received, turned


@dataclass(frozen=True, eq=False)
class MeasuringLidar:
    """A lidar whose scans stay in its own frame.

    Attributes
    ----------
    recording : Recording
        Recording with the topic of this lidar.
    mounting : Mounting or None
    limits : ScanParameters or None
        Limits of its ranges and of its range noise. Both are None for a single lidar.
    """

    recording: Recording
    mounting: Mounting | None = None
    limits: ScanParameters | None = None

    def scans(self, parameters):
        """Return the scans; those of one of several lidars without masked returns, and as of an upright lidar.

        Then `parameters` (`NodeParameters`) have its mask and its time offset.
        """
        scans = self.recording.scans()
        if self.mounting is None:
            return scans
        own = (parameters or NodeParameters()).input_of(self.recording.topic)
        return turned(received(scans, own), 0.0, self.mounting.upside_down)


def measuring_lidars(path, lidars, parameters) -> list:
    """Open the recording at `path` for each of the `lidars` (`Lidars`); return a `MeasuringLidar` for each.

    `parameters` are `NodeParameters` or None. Raises as `further_lidars`.
    """
    own, parameters = CloudParameters.of(parameters, lidars.first), parameters or NodeParameters()
    lidars = lidars.of_recording(path, parameters)
    if len(lidars.topics) <= 1:
        return [MeasuringLidar(open_recording(path, lidars.first, own))]
    recording = lidars.open(path, parameters)
    mounting, others = lidars_of(recording, lidars, parameters)
    return [MeasuringLidar(recording, mounting, parameters.lidar(recording.topic).scan),
            *(MeasuringLidar(each.recording, each.mounting, each.limits) for each in others)]
