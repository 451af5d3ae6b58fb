# SPDX-License-Identifier: Apache-2.0
"""Rays into the world, past the robot itself."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

# Geoms of a robot are of this group, which is drawn and never hit by these rays.
ROBOT_GROUP = 2
_OTHERS = np.array([group != ROBOT_GROUP for group in range(6)], dtype=np.uint8)
DOWN = np.array([0.0, 0.0, -1.0])


def free_m(
    model: Any, data: Any, origin_m: NDArray[np.float64], direction: NDArray[np.float64]
) -> float | None:
    """Return the way (m) to the first geom along a unit vector, None when there is none."""
    hit = np.full(1, -1, dtype=np.int32)
    way = mujoco.mj_ray(model, data, origin_m, direction, _OTHERS, 1, -1, hit)
    return None if way < 0 else float(way)


def height_below_m(model: Any, data: Any, point_m: NDArray[np.float64]) -> float | None:
    """Return the height of the first surface below a point, None when there is none."""
    way = free_m(model, data, point_m, DOWN)
    return None if way is None else float(point_m[2]) - way
