# SPDX-License-Identifier: Apache-2.0
"""Named paths for test drives: `closed-10m`, `open-20m`, `square-12m`, `eight-30m`, ..."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pilotage.errors import InputError

Points = NDArray[np.float64]
SPACING_M = 0.02
SHORTEST_M, LONGEST_M = 1.0, 1000.0
_CORNER = 0.12  # radius of a square's corners, as a part of its side


@dataclass(frozen=True)
class DrivePath:
    """`points` (N, 2), metres in the frame of the start, which they leave along x."""

    name: str
    points: Points
    is_closed: bool

    @property
    def length_m(self) -> float:
        """Return the length along the points."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())

    def centre(self) -> Points:
        """Return the middle (2,) of the box around the path."""
        return np.asarray((self.points.min(axis=0) + self.points.max(axis=0)) / 2)


def parse_path(name: str) -> DrivePath:
    """Return the path called `<shape>-<length>m`; InputError tells shapes and lengths."""
    match = re.fullmatch(r"([a-z]+)-(\d+(?:\.\d+)?)m", name) if isinstance(name, str) else None
    shapes = ", ".join(SHAPES)
    if match is None or match[1] not in SHAPES:
        raise InputError(
            f"path {name!r}: must be SHAPE-LENGTHm such as closed-10m; shapes are {shapes}"
        )
    length_m = float(match[2])
    if not SHORTEST_M <= length_m <= LONGEST_M:
        raise InputError(
            f"path {name!r}: its length must lie from {SHORTEST_M:g} to {LONGEST_M:g} m"
        )
    points = _scaled(SHAPES[match[1]](), length_m)
    return DrivePath(name, points, is_closed=match[1] not in OPEN_SHAPES)


def distances_m(points: Points, path: Points) -> NDArray[np.float64]:
    """Return the distance (N,) of each of `points` (N, 2) to the nearest point of `path`."""
    apart = np.linalg.norm(points[:, None, :] - path[None, :, :], axis=2)
    return np.asarray(apart.min(axis=1))


def _scaled(shape: Points, length_m: float) -> Points:
    """Return the shape moved and turned to the start, of that length, evenly spaced."""
    heading = shape[1] - shape[0]
    c, s = heading / np.linalg.norm(heading)
    turned = (shape - shape[0]) @ np.array([[c, -s], [s, c]])
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(turned, axis=0), axis=1))])
    steps = max(2, round(length_m / SPACING_M))
    wanted = np.linspace(0, along[-1], steps + 1)
    even = np.column_stack([np.interp(wanted, along, turned[:, i]) for i in range(2)])
    return np.asarray(even * (length_m / along[-1]))


def _closed() -> Points:
    """Return an uneven oval, so that the curvature is never the same for long."""
    angle = np.linspace(0, 2 * math.pi, 2001) - math.pi / 2
    radius = 1 + 0.12 * np.cos(2 * angle) + 0.05 * np.sin(3 * angle)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def _open() -> Points:
    """Return two gentle bends."""
    x = np.linspace(0, 2 * math.pi, 2001)
    return np.column_stack([x, 0.6 * np.sin(x) * np.sin(x / 2)])


def _straight() -> Points:
    return np.array([[0.0, 0.0], [1.0, 0.0]])


def _square() -> Points:
    """Return a square with rounded corners, from the middle of one side."""
    arc = np.linspace(0, math.pi / 2, 100)
    corner = 0.5 - _CORNER + _CORNER * np.column_stack([np.sin(arc), 1 - np.cos(arc)])
    corner[:, 1] -= 1 - _CORNER
    sides = [corner]
    for _ in range(3):
        sides.append(sides[-1] @ np.array([[0.0, 1.0], [-1.0, 0.0]]))
    begin = np.array([[0.0, -0.5]])
    return np.concatenate([begin, *sides, begin])


def _eight() -> Points:
    angle = np.linspace(0, 2 * math.pi, 2001)
    return np.column_stack([np.sin(angle), np.sin(angle) * np.cos(angle)])


SHAPES: dict[str, Callable[[], Points]] = {
    "closed": _closed,
    "open": _open,
    "straight": _straight,
    "square": _square,
    "eight": _eight,
}
OPEN_SHAPES = ("open", "straight")
