# SPDX-License-Identifier: Apache-2.0
"""A model set upright: which way is up, and along what it is looked at."""

from __future__ import annotations

import numpy as np

from pilotage.evaluation.poses import Array

# A mean of directions shorter than this has none: the directions cancel.
LEAST_MEAN = 0.1


def level_from_world(world_from_camera: Array) -> Array:
    """Return the (3, 3) rotation into x along the main way, z up, from (P, 4, 4) poses.

    Up is the mean of what is up in the pictures. The main way is the level direction in which
    the cameras spread most; where there is none, the one they look in. Of its two ends x points
    to that of the last picture, or, where the cameras look across the way, to the pictures' right.
    """
    rotations, centres = world_from_camera[:, :3, :3], world_from_camera[:, :3, 3]
    up = _mean_direction(-rotations[:, :, 1])
    looks = rotations[:, :, 2].mean(axis=0)
    along = _main_direction(centres, up)
    if along is None:
        along = looks - (looks @ up) * up
        if np.linalg.norm(along) < LEAST_MEAN:  # they look straight down, or all around
            along = rotations[0, :, 0] - (rotations[0, :, 0] @ up) * up
        along /= np.linalg.norm(along)
    across = np.cross(up, along)
    looks_across = abs(looks @ across) > abs(looks @ along)
    is_backward = looks @ across < 0 if looks_across else (centres[-1] - centres[0]) @ along < 0
    sign = -1.0 if is_backward else 1.0
    return np.array([sign * along, sign * across, up])


def _mean_direction(directions: Array) -> Array:
    """Return the (3,) unit mean of (P, 3) directions; the first of them where they cancel."""
    mean = directions.mean(axis=0)
    if np.linalg.norm(mean) < LEAST_MEAN:
        mean = directions[0]
    return np.asarray(mean / np.linalg.norm(mean))


def _main_direction(centres: Array, up: Array) -> Array | None:
    """Return the level unit direction in which (P, 3) spread most; None where they do not."""
    spread = centres - centres.mean(axis=0)
    level = spread - np.outer(spread @ up, up)
    if not level.any():
        return None
    _, sizes, directions = np.linalg.svd(level, full_matrices=False)
    # Of cameras that moved up and down alone what is left is rounding.
    if sizes[0] <= 1e-6 * np.linalg.norm(spread):
        return None
    along = directions[0] - (directions[0] @ up) * up
    return np.asarray(along / np.linalg.norm(along))


def limits_of(points: Array, cameras: Array) -> Array:
    """Return (2, D), lowest and highest: all (P, D) cameras and most of the (N, D) points.

    Few points that lie far away (or were found so) would make all others a dot: what reaches
    beyond the middle nine tenths by more than a sixth of their extent is left outside.
    """
    low, high = cameras.min(axis=0), cameras.max(axis=0)
    if len(points):
        inner = np.quantile(points, (0.05, 0.95), axis=0)
        reach = (inner[1] - inner[0]) / 6
        low = np.minimum(low, np.maximum(points.min(axis=0), inner[0] - reach))
        high = np.maximum(high, np.minimum(points.max(axis=0), inner[1] + reach))
    margin = 0.04 * max(float((high - low).max()), 1e-9)
    return np.array([low - margin, high + margin])
