"""Laser odometry: keeps a reference, registers every scan to it and integrates the pose."""
from .parameters import Parameters
from .records import OdometryUpdate, Prior
from .scan import Scan
from .se2 import SE2


class Odometry:
    """Poses from a stream of scans.

    Parameters
    ----------
    parameters : Parameters
        May be replaced at any time; a new value counts from the next scan on.
    """

    def __init__(self, parameters: Parameters = Parameters()):
        self.parameters = parameters

    def reset(self, pose: SE2 = SE2()):
        """Forget the reference; the next scan starts anew at `pose`."""

    def process(self, scan: Scan, prior: Prior | None = None) -> OdometryUpdate:
        """Register `scan` and say where the sensor is.

        Raises
        ------
        ScanError
            When the scan holds too few returns to be used; the state is unchanged.
        """
        raise NotImplementedError
