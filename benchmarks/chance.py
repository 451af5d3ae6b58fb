# SPDX-License-Identifier: Apache-2.0
"""How large the squared errors of poses over their covariances (NEES) become by chance alone.

With honest covariances each is chi-square with 6 degrees of freedom.
"""

from __future__ import annotations

from scipy.stats import chi2

DEGREES = 6


def ordinary_limit() -> float:
    """Return what 99 of 100 stay below."""
    return float(chi2.ppf(0.99, DEGREES))


def largest_by_chance(count: int) -> float:
    """Return what chance exceeds once in a hundred runs of so many: a pose confidently wrong."""
    return float(chi2.ppf(1 - 0.01 / count, DEGREES))


def mean_band(count: int) -> tuple[float, float]:
    """Return between what the mean of so many lies 99 times in 100."""
    low, high = chi2.ppf([0.005, 0.995], DEGREES * count) / count
    return float(low), float(high)
