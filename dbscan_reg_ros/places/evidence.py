# SPDX-License-Identifier: Apache-2.0
"""Evidence for poses in a map: what should be seen and is, and what should be seen and is not.

Each square of a drive counts once, however many scans saw it, and what is unknown in the map does not count.
"""
import numpy as np
from numpy.typing import NDArray

RIGHT_ON, WRONG_ON = 0.93, 0.80
"""Probability that a return lies on a surface of the map: at the right pose, and at the best of all wrong ones."""
UNKNOWN = -0.05
"""Log-odds of a return where the map knows nothing: less likely at the right pose, unless the map ends near by."""
INDEPENDENT = 3.0
"""Number of returns, a tenth of a metre apart, that are as good as one that depends on no other."""
FOUND = 0.7
"""Probability that the right pose is among the candidates of a scan."""
ALIKE = 0.1
"""Probability that another place in the map suits the drive as well as the best one that was found."""
INSIDE = 0.5
"""Probability that the sensor is in the map, before anything was seen."""


def log_odds(counts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the log-odds (H,) of hypotheses against chance from their `Matcher.count` (H, 6)."""
    on, off, unknown, _, blocked, _ = counts.T
    for_it, against = np.log(RIGHT_ON / WRONG_ON), np.log((1.0 - RIGHT_ON) / (1.0 - WRONG_ON))
    return (on * for_it + (off + blocked) * against + unknown * UNKNOWN) / INDEPENDENT


def probabilities(odds: NDArray[np.float64], scans: int) -> tuple[NDArray[np.float64], float, float]:
    """Return the probabilities of hypotheses with these log-odds (H,), and those of what they leave out.

    The right place is elsewhere in the map if it was among the candidates of none of the `scans`; or it is outside.

    Returns
    -------
    inside : (H,) float
    missed, outside : float
    """
    likelihood = np.exp(np.clip(odds, -50.0, 50.0))
    unfound = (1.0 - FOUND) ** scans
    weight = INSIDE * (1.0 - unfound) * likelihood
    # A place that was not found yet may suit the drive as well as the best.
    missed = INSIDE * unfound * (1.0 + ALIKE * likelihood.max())
    total = weight.sum() + missed + 1.0 - INSIDE
    return weight / total, missed / total, (1.0 - INSIDE) / total
