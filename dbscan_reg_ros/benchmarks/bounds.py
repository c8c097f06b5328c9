"""What must hold of a figure."""
from dataclasses import dataclass


@dataclass(frozen=True)
class Bound:
    """A limit that a metric may not cross."""

    limit: float
    upper: bool

    def holds(self, value):
        """False for `nan`: what was not measured is not shown."""
        return value <= self.limit if self.upper else value >= self.limit

    def __str__(self):
        return f'at {"most" if self.upper else "least"} {self.limit:g}'


def at_least(limit):
    return Bound(limit, False)


def at_most(limit):
    return Bound(limit, True)
