# SPDX-License-Identifier: Apache-2.0
"""What a replay finds about the lidars: where they see the robot itself, and when their beams are measured."""
from ..recordings.checks.scan_warnings import Kind
from ..robot.own_body import OwnBody, advice, described


class OwnBodies:
    """Finds for each lidar where it sees the robot itself, as the node does; collects what the odometry finds.

    Parameters
    ----------
    lidars : list of (str, Mounting)
        Topic and mounting of each lidar, in the order of their ranks.
    """

    def __init__(self, lidars):
        self._lidars = [(topic, mounting, OwnBody()) for topic, mounting in lidars]
        self._findings = []

    def add(self, scan, update):
        """Add a scan and its `OdometryUpdate`."""
        topic, _, body = self._lidars[update.sensor.rank]
        if update.finding:
            text = f'{update.finding} (from scan {update.number} on)'
            self._findings.append((topic, Kind.TIME_INCREMENT.value, text))
        body.add(scan, update.pose @ update.sensor.pose)

    def found(self, parameters) -> list:
        """Return topic of the lidar, kind, and a sentence with what to do, for all that was found."""
        seen = [(parameters.lidar(topic), topic, [each.in_lidar(mounting) for each in body.sectors])
                for topic, mounting, body in self._lidars if body.sectors]
        several = len(self._lidars) > 1
        return self._findings + [
            (topic, 'own_body', f'{described(sectors)}; {advice(lidar.name, several, lidar.input.mask, sectors)}')
            for lidar, topic, sectors in seen]
