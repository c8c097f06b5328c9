# SPDX-License-Identifier: Apache-2.0
"""Registration and odometry as programs call them: wrong fields of scans cause a Python warning."""
import functools
import warnings
from collections import defaultdict

from ...core.errors import expect
from ...core.geometry.se2 import SE2
from ...core.odometry import pipeline
from ...core.odometry.calibration.comparisons import LidarComparisons
from ...core.odometry.records import OdometryUpdate
from ...core.parameters.tree import Parameters
from ...core.registration import pipeline as registration
from ...core.registration.records import Prior, Registration, expect_prior
from ...core.scan import Scan, expect_scan
from ...core.sensor import FIRST, Sensor
from .scan_checks import Kind, RangeChecks, ScanChecks, ScanFields


class Odometry(pipeline.Odometry):
    """Estimates the poses of a moving sensor, scan by scan; warns once of each kind of wrong fields of its scans.

    Parameters
    ----------
    parameters : Parameters
        All parameters. They can be replaced at any time; new values apply from the next scan on, and existing key
        frames are not changed.
    comparisons : LidarComparisons, optional
        Comparison of further lidars with the first one; decides whether they are used.

    Attributes
    ----------
    comparisons : LidarComparisons
    """

    def __init__(self, parameters: Parameters = Parameters(),
                 comparisons: LidarComparisons | None = None):
        super().__init__(parameters, comparisons)
        self._checks: dict[str, ScanChecks] = defaultdict(ScanChecks)
        self._warned: set[tuple[str, Kind]] = set()

    def reset(self, pose: SE2 = SE2()) -> None:  # noqa: D102 - the docstring is inherited
        expect('pose', pose, SE2, 'SE2(x, y, theta) [m, m, rad]')
        for checks in self._checks.values():
            checks.restart()
        super().reset(pose)

    def process(self, scan: Scan, prior: Prior | None = None,  # noqa: D102 - the docstring is inherited
                sensor: Sensor = FIRST) -> OdometryUpdate:
        expect_scan(scan)
        expect_prior(prior)
        expect('sensor', sensor, Sensor, 'Sensor(name, pose)')
        for warning in self._checks[sensor.name].look(ScanFields.from_scan(scan)):
            if (sensor.name, warning.kind) not in self._warned:
                self._warned.add((sensor.name, warning.kind))
                warnings.warn(warning.text, stacklevel=2)
        return super().process(scan, prior, sensor)


@functools.wraps(registration.register)
def register(reference, current, *args, **kwargs) -> Registration:  # noqa: D103 - the docstring is that of the core
    scans = [each for each in (reference, current) if isinstance(each, Scan)]
    found = {warning.kind: warning.text for scan in scans for warning in RangeChecks().look(ScanFields.from_scan(scan))}
    for text in found.values():
        warnings.warn(text, stacklevel=2)
    return registration.register(reference, current, *args, **kwargs)
