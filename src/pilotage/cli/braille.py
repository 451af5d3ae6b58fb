# SPDX-License-Identifier: Apache-2.0
"""A small map for a terminal: points as the dots of braille characters, seen from above."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
# A character has two columns of four dots; this is the bit of each, by row and column.
DOT_BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
BLANK = 0x2800
ARROWS = "→↗↑↖←↙↓↘"


class BrailleMap:
    """A map of `columns` x `rows` characters around some points, metres, x right and y up.

    A dot is as wide as it is high on a usual terminal, so shapes are kept.
    """

    def __init__(self, around: Points, *, columns: int, rows: int) -> None:
        self.columns, self.rows = columns, rows
        low, high = around.min(axis=0), around.max(axis=0)
        dots = np.array([2 * columns, 4 * rows]) - 5  # a margin of two dots on either side
        # A straight path has no width of its own.
        self.metres_per_dot = float(max(0.01, *(high - low) / dots))
        self._middle = (low + high) / 2

    def cells(self, points: Points) -> NDArray[np.int64]:
        """Return (rows, columns) of dots as bits, 0 where no point (N, 2) lies; others are cut."""
        cells = np.zeros((self.rows, self.columns), np.int64)
        x, y = self._dots(points).T
        inside = (x >= 0) & (x < 2 * self.columns) & (y >= 0) & (y < 4 * self.rows)
        x, y = x[inside], y[inside]
        np.bitwise_or.at(cells, (y // 4, x // 2), DOT_BITS[y % 4, x % 2])
        return cells

    def cell_of(self, point: Points) -> tuple[int, int] | None:
        """Return row and column of the character where a point (2,) lies, None outside."""
        x, y = self._dots(point[None])[0].tolist()
        row, column = y // 4, x // 2
        inside = 0 <= row < self.rows and 0 <= column < self.columns
        return (row, column) if inside else None

    def _dots(self, points: Points) -> NDArray[np.int64]:
        """Return the dots (N, 2), columns to the right and rows down."""
        middle = np.array([self.columns, 2 * self.rows])
        dots = middle + (points - self._middle) / self.metres_per_dot * np.array([1, -1])
        return np.asarray(np.floor(dots), np.int64)


def arrow(yaw_rad: float) -> str:
    """Return the arrow that points nearest to a heading; 0 is to the right, up is positive."""
    return ARROWS[round(yaw_rad / (np.pi / 4)) % len(ARROWS)]
