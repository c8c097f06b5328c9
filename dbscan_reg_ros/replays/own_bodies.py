# SPDX-License-Identifier: Apache-2.0
"""What a replay finds about the lidars: where they see the robot itself, and when their beams are measured."""
from ..core.sensor import FIRST
from ..recordings.checks.scan_warnings import Kind
from ..robot.own_body import OwnBody, advice, described


class OwnBodies:
    """Finds for each lidar where it sees the robot itself, as the node does; collects what the odometry finds.

    Parameters
    ----------
    lidars : list of (str, Mounting)
        Topic and mounting of each lidar, in the order of their ranks.

    Attributes
    ----------
    comparisons : LidarComparisons
        Those of the odometry.
    """

    def __init__(self, lidars):
        self._lidars = [(topic, mounting, OwnBody()) for topic, mounting in lidars]
        self._findings = []

    def watching(self, odometry):
        """Return the `odometry`, each scan of which is searched."""
        self._odometry, self.comparisons = odometry, odometry.comparisons
        return self

    def process(self, scan, prior=None, sensor=FIRST):
        """Return the update for a scan; arguments, results and errors are those of `Odometry.process`."""
        update = self._odometry.process(scan, prior, sensor)
        topic, _, body = self._lidars[sensor.rank]
        if update.finding:
            text = f'{update.finding} (from scan {update.number} on)'
            self._findings.append((topic, Kind.TIME_INCREMENT.value, text))
        body.add(scan, update.pose @ update.sensor.pose)
        return update

    def found(self, parameters) -> list:
        """Return topic of the lidar, kind, and a sentence with what to do, for all that was found."""
        seen = [(parameters.lidar(topic), topic, [each.in_lidar(mounting) for each in body.sectors])
                for topic, mounting, body in self._lidars if body.sectors]
        several = len(self._lidars) > 1
        return self._findings + [
            (topic, 'own_body', f'{described(sectors)}; {advice(lidar.name, several, lidar.input.mask, sectors)}')
            for lidar, topic, sectors in seen]
