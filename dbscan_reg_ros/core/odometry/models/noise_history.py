# SPDX-License-Identifier: Apache-2.0
"""Noise ratio of a sensor over its last scans."""
from dataclasses import dataclass


@dataclass(frozen=True)
class NoiseRatioHistory:
    """Noise ratio of a sensor: a low quantile over the last scans, because clutter increases the ratio in some scans.

    Attributes
    ----------
    ratios : tuple of float
        `estimate_noise_ratio` of the last scans.
    """

    ratios: tuple[float, ...] = ()

    def after(self, ratio: float) -> 'NoiseRatioHistory':
        """Return the history with the `ratio` of one more scan."""
        return NoiseRatioHistory((*self.ratios, ratio)[-_SCANS:])

    @property
    def value(self) -> float:
        """Low quantile of `ratios`, which must not be empty."""
        return sorted(self.ratios)[int(_QUANTILE * len(self.ratios))]


_QUANTILE = 0.3
"""Quantile of the history that gives the noise ratio of the sensor."""
_SCANS = 30
"""Number of scans in the history of the noise ratio."""
