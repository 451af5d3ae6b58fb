# SPDX-License-Identifier: Apache-2.0
"""The relief of a ground: smooth noise of several octaves, level where it has to be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

OCTAVES = 4
CELLS_OF_WAVE = 20  # of the longest; the shortest has two and a half

Grid = NDArray[np.float64]


@dataclass(frozen=True)
class Relief:
    """Heights (rows, columns) in metres on a square grid; row 0 at the smallest y."""

    heights_m: Grid
    centre_m: tuple[float, float]
    half_m: float

    def height_m(self, x_m: float, y_m: float) -> float:
        """Return the height at a point, linear between the grid's; 0 where there is no relief."""
        size = self.heights_m.shape[0] - 1
        if size < 1:
            return 0.0
        cell = 2 * self.half_m / size
        column = np.clip((x_m - self.centre_m[0] + self.half_m) / cell, 0, size - 1e-9)
        row = np.clip((y_m - self.centre_m[1] + self.half_m) / cell, 0, size - 1e-9)
        i, j = int(row), int(column)
        v, u = row - i, column - j
        h = self.heights_m[i : i + 2, j : j + 2]
        upper = h[1, 0] * (1 - u) + h[1, 1] * u
        return float((h[0, 0] * (1 - u) + h[0, 1] * u) * (1 - v) + upper * v)

    def level_around(self, x_m: float, y_m: float, radius_m: float) -> Relief:
        """Return the relief with a level disc around a point, blended over its own radius."""
        size = self.heights_m.shape[0]
        if size < 2:
            return self
        axis = np.linspace(-self.half_m, self.half_m, size)
        apart = np.hypot(
            axis[None, :] + self.centre_m[0] - x_m, axis[:, None] + self.centre_m[1] - y_m
        )
        t = np.clip(apart / radius_m - 1, 0, 1)
        share = t * t * (3 - 2 * t)
        height = self.height_m(x_m, y_m)
        heights = height + (self.heights_m - height) * share
        return Relief(heights, self.centre_m, self.half_m)


def make_relief(
    rng: np.random.Generator,
    centre_m: tuple[float, float],
    half_m: float,
    amplitude_m: float,
    wave_m: float,
) -> Relief:
    """Return a relief between -amplitude and +amplitude, 0 and level around the world's origin.

    `wave_m` is its longest wave; each octave halves it.
    """
    if amplitude_m == 0:
        return Relief(np.zeros((1, 1)), centre_m, half_m)
    cell_m = wave_m / CELLS_OF_WAVE
    size = round(2 * half_m / cell_m) + 1
    heights = np.zeros((size, size))
    for octave in range(OCTAVES):
        sigma = CELLS_OF_WAVE / 4 / 2**octave
        wave = gaussian_filter(rng.standard_normal((size, size)), sigma, mode="reflect")
        heights += wave / wave.std() * 0.4**octave
    heights *= amplitude_m / np.abs(heights).max()
    relief = Relief(heights, centre_m, half_m)
    at_origin = relief.height_m(0, 0)
    lowered = Relief(heights - at_origin, centre_m, half_m)
    return lowered.level_around(0, 0, 1.2)
