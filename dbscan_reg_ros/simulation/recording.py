# SPDX-License-Identifier: Apache-2.0
"""A simulation with the interface of a recording on disk."""
from collections.abc import Iterator

from ..core.scan import Scan
from ..recordings.recording import Recording, StampedPoses
from .simulate import Simulation


class SimulatedRecording(Recording):
    """The scans and true poses of a `Simulation` as a recording."""

    topic = 'scan'

    def __init__(self, name: str, simulation: Simulation):
        super().__init__(name)
        self._simulation = simulation
        self.frame_id = simulation.lidar.frame_id
        self.count = len(simulation.scans)

    def scans(self) -> Iterator[Scan]:
        """Return an iterator over the simulated scans."""
        return iter(self._simulation.scans)

    def truth(self) -> StampedPoses:
        """Return stamps ``(N,)`` [ns] and true poses ``(N, 3)`` [m, m, rad] of the sensor in the world."""
        return self._simulation.stamps, self._simulation.truth
