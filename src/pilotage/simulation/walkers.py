# SPDX-License-Identifier: Apache-2.0
"""Bodies that go round on a closed path by the clock, as a note in the MJCF says.

<custom><text name="walk:person" data="speed_m_s=0.7 points_m=1,0 2,0 2,1"/></custom>

moves the mocap body `person` through these points and back to the first, facing ahead.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pilotage.errors import InputError
from pilotage.simulation.paths import Points
from pilotage.simulation.scene import WALK_PREFIX, yaw_quaternion


@dataclass(frozen=True)
class Walk:
    """`points` (N, 2) of a closed path, metres in the world, and the speed along it."""

    body: str
    points: Points
    speed_m_s: float

    def note(self) -> tuple[str, str]:
        """Return name and text of the note that says this walk."""
        points = " ".join(f"{x:.3f},{y:.3f}" for x, y in self.points)
        return WALK_PREFIX + self.body, f"speed_m_s={self.speed_m_s:.3f} points_m={points}"

    def pose(self, time_s: float) -> tuple[Points, NDArray[np.float64]]:
        """Return position (2,) and quaternion wxyz (4,) in the world at a time."""
        loop, along = self._loop
        s = (time_s * self.speed_m_s) % along[-1]
        i = min(int(np.searchsorted(along, s, side="right")) - 1, len(loop) - 2)
        step = loop[i + 1] - loop[i]
        share = (s - along[i]) / (along[i + 1] - along[i])
        yaw = math.atan2(step[1], step[0])
        return loop[i] + share * step, np.array(yaw_quaternion(yaw))

    @cached_property
    def _loop(self) -> tuple[Points, NDArray[np.float64]]:
        loop = np.concatenate([self.points, self.points[:1]])
        steps = np.linalg.norm(np.diff(loop, axis=0), axis=1)
        return loop, np.concatenate([[0.0], np.cumsum(steps)])


def read_walk(name: str, text: str) -> Walk:
    """Return the walk of a note; InputError says how one is written."""
    match = re.fullmatch(r"\s*speed_m_s=(\S+)\s+points_m=(.+?)\s*", text)
    try:
        if match is None:
            raise ValueError("two values are wanted")
        points = np.array([[float(v) for v in p.split(",")] for p in match[2].split()])
        speed = float(match[1])
        steps = np.diff(np.concatenate([points, points[:1]]), axis=0)
        if points.shape[1:] != (2,) or not np.isfinite(points).all() or not 0 < speed < 100:
            raise ValueError("points are pairs, the speed is positive")
        if not np.linalg.norm(steps, axis=1).min() > 0:
            raise ValueError("a point is repeated")
    except ValueError as error:
        raise InputError(
            f"text {name!r} = {text[:60]!r}: {error}; "
            "write speed_m_s=0.7 points_m=0,0 1,0 1,1, three points or more"
        ) from error
    return Walk(name.removeprefix(WALK_PREFIX), points, speed)
