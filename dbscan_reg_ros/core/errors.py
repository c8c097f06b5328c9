# SPDX-License-Identifier: Apache-2.0
"""The exceptions of the package: every one names the value, the expected one and what to do."""


class DbscanRegError(Exception):
    """Base class of every error that this package raises on purpose."""


class ScanError(DbscanRegError, ValueError):
    """A scan cannot be used: nothing was changed, the next scan may be good again."""


class ParameterError(DbscanRegError, ValueError):
    """A parameter is unknown, has the wrong type or lies outside its bounds."""


class RecordingError(DbscanRegError, ValueError):
    """A recording cannot be read, or does not hold what was asked for."""
