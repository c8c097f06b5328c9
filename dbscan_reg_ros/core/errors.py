# SPDX-License-Identifier: Apache-2.0
"""The exceptions of the package: each message states the value, the expected value and the remedy."""


class DbscanRegError(Exception):
    """Base class of every error that this package raises on purpose."""


class ArgumentError(DbscanRegError, ValueError):
    """An argument is of a wrong type, or is no pose or no covariance."""


class ScanError(DbscanRegError, ValueError):
    """A scan cannot be used; the state of the odometry is unchanged, and the next scan can be processed."""


class ParameterError(DbscanRegError, ValueError):
    """A parameter is unknown, has the wrong type or lies outside its bounds."""


class RecordingError(DbscanRegError, ValueError):
    """A recording cannot be read, or does not contain the requested data."""


class BuildError(DbscanRegError, ImportError):
    """The compiled modules are missing, or were built from other sources."""


def expect(name: str, value: object, kind: type, how: str, error: type[DbscanRegError] = ArgumentError) -> None:
    """Raise an `error` unless the value of the argument `name` is of the type `kind`; `how` shows one."""
    if not isinstance(value, kind):
        raise error(f'{name} is of type {type(value).__name__}; expected {how}')
