# SPDX-License-Identifier: Apache-2.0
"""What chance alone does: to the squared errors of poses over their covariances (NEES), of which
each is chi-square with 6 degrees of freedom where covariances are honest, and to a mean of two.
"""

from __future__ import annotations

import numpy as np
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


def mean_beside_luckier(sigma_ratio: float, factor: float) -> float:
    """Return how often the best mean of two positions is `factor` times as far off as the luckier.

    Both are off by independent normal errors in three axes, the sigma of one `sigma_ratio` times
    the other's, and both sigmas are known: no weights do better on average.
    """
    random = np.random.default_rng(0)
    first, second = random.normal(size=(2, 200_000, 3))
    second *= sigma_ratio
    weight = 1 / sigma_ratio**2
    mean = (first + weight * second) / (1 + weight)
    off, first_off, second_off = (np.linalg.norm(e, axis=1) for e in (mean, first, second))
    return float(np.mean(off > factor * np.minimum(first_off, second_off)))
