# SPDX-License-Identifier: Apache-2.0
"""A simulation behind the interface of the recordings on disk."""
from ..recordings import Recording


class SimulatedRecording(Recording):
    """The scans of a `Simulation`, with their truth.

    Parameters
    ----------
    name : str
    simulation : Simulation
    """

    topic = 'scan'

    def __init__(self, name, simulation):
        super().__init__(name)
        self._simulation = simulation
        self.frame_id = simulation.lidar.frame_id
        self.count = len(simulation.scans)

    def scans(self):
        return iter(self._simulation.scans)

    def truth(self):
        return self._simulation.stamps, self._simulation.truth
