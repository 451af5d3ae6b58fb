# SPDX-License-Identifier: Apache-2.0
"""Where things stand: circles that never overlap, clear of where the robot is to drive."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from pilotage.errors import InputError
from pilotage.simulation.paths import Points, distances_m

GAP_M = 0.5
TRIES = 400


@dataclass(frozen=True)
class Circle:
    """A place that is taken, metres in the world."""

    x_m: float
    y_m: float
    radius_m: float


@dataclass
class Layout:
    """A square area and what is taken of it; `place` takes more."""

    centre_m: tuple[float, float]
    half_m: float
    path: Points = field(default_factory=lambda: np.zeros((1, 2)))
    path_clear_m: float = 1.0
    taken: list[Circle] = field(default_factory=list)

    def take(self, x_m: float, y_m: float, radius_m: float) -> Circle:
        """Take a circle, whatever is there."""
        circle = Circle(x_m, y_m, radius_m)
        self.taken.append(circle)
        return circle

    def place(self, rng: np.random.Generator, radius_m: float) -> Circle | None:
        """Take a free circle of that radius, or return None when there is no room for it."""
        reach = self.half_m - radius_m
        for _ in range(TRIES if reach > 0 else 0):
            x, y = np.asarray(self.centre_m) + rng.uniform(-reach, reach, 2)
            if self._is_free(x, y, radius_m):
                return self.take(float(x), float(y), radius_m)
        return None

    def place_between(
        self, rng: np.random.Generator, radius_m: float, low_m: float, high_m: float
    ) -> Circle:
        """Take a free circle between two distances from the origin; InputError when none is."""
        for _ in range(TRIES):
            angle, away = rng.uniform(-math.pi, math.pi), rng.uniform(low_m, high_m)
            x, y = away * math.cos(angle), away * math.sin(angle)
            if self._is_free(x, y, radius_m):
                return self.take(x, y, radius_m)
        raise InputError("the marks find no room; raise size_m, or lower path_clear_m")

    def _is_free(self, x_m: float, y_m: float, radius_m: float) -> bool:
        inside = max(abs(x_m - self.centre_m[0]), abs(y_m - self.centre_m[1])) + radius_m
        if inside > self.half_m:
            return False
        for other in self.taken:
            apart = math.hypot(x_m - other.x_m, y_m - other.y_m)
            if apart < radius_m + other.radius_m + GAP_M:
                return False
        return bool(
            distances_m(np.array([[x_m, y_m]]), self.path)[0] > radius_m + self.path_clear_m
        )
