"""What a baseline says of two scans."""
from dataclasses import dataclass

from ..core.records import Status
from ..core.se2 import SE2


@dataclass(frozen=True)
class Result:
    """The part of `core.records.Registration` that every method can fill.

    Attributes
    ----------
    transform : SE2
        Pose of the current sensor in the reference's frame: ``p_R = transform.apply(p_O)``.
    status : Status
    """

    transform: SE2
    status: Status
