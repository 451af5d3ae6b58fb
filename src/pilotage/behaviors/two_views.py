# SPDX-License-Identifier: Apache-2.0
"""The geometry of two pictures refined, and the depths it gives, with honest standard errors.

Rays are (N, 3) with z = 1, each in its own camera; the baseline is the unit of length.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pilotage import Transform

Array = NDArray[np.float64]

ROUNDS = 40
SETTLING_ROUNDS = 6  # in which the residuals' scale may still change
STEP = 1e-6
TAIL = 4.0  # freedom of the Student distribution that errors follow: blunders count little
CELLS = 8  # the picture's sides are cut into so many, to let near errors be alike
SHARED = 2.0  # variance of the motion: errors of patches are alike beyond a cell as well (measured)
LEAST_SCALE = 0.2  # of the errors told: no measurement is so much better than it says


@dataclass(frozen=True, kw_only=True, eq=False)
class Rays:
    """Matched rays (N, 3), and the standard errors (N, 2) of x and y of the second ones."""

    first: Array
    second: Array
    sigma: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class TwoViews:
    """Where the second camera was, seen from the first, the distance of the two being 1.

    `covariance` (5, 5): three rotations (left perturbation, rad) and two of the direction, rad.
    `scale` is what the standard errors of the rays had to be multiplied with to fit, `residual`
    (N,) the distance of each second ray from its epipolar line, in such standard errors.
    """

    second_from_first: Transform
    covariance: Array
    scale: float
    residual: Array


def refine_two_views(rays: Rays, start: Transform) -> TwoViews:
    """Return the motion that leaves the least distances from epipolar lines, blunders aside.

    The covariance takes errors of neighbouring points as one: a surface that moved, or a blob that
    looks different from elsewhere, shifts many alike.
    """
    rotation, direction = _parts(start)
    residual = _residuals(rotation, direction, rays)
    scale = _spread(residual)
    for turn in range(ROUNDS):
        slopes = _slopes(_residuals, rotation, direction, rays)
        weight = (TAIL + 1) / (TAIL + (residual / scale) ** 2)
        step = -_solve(slopes, weight, residual)
        rotation, direction = _moved(rotation, direction, step)
        residual = _residuals(rotation, direction, rays)
        if turn < SETTLING_ROUNDS:
            scale = _spread(residual)
        elif np.linalg.norm(step) < STEP:
            break
    slopes = _slopes(_residuals, rotation, direction, rays)
    return TwoViews(
        second_from_first=_joined(rotation, direction),
        covariance=_covariance(slopes, residual / scale, scale, rays.first),
        scale=scale,
        residual=residual / scale,
    )


def depths(second_from_first: Transform, rays: Rays) -> Array:
    """Return (N,) depths in the first camera, negative where rays meet behind it."""
    return _depths(*_parts(second_from_first), rays)


def depth_errors(views: TwoViews, rays: Rays) -> tuple[Array, Array]:
    """Return the standard errors (N,) of the depths that pixels and the motion leave, apart."""
    rotation, direction = _parts(views.second_from_first)
    by_pixel = np.zeros(len(rays.first))
    for axis in range(2):
        shift = np.zeros(3)
        shift[axis] = STEP
        more = _depths(rotation, direction, replace(rays, second=rays.second + shift))
        less = _depths(rotation, direction, replace(rays, second=rays.second - shift))
        by_pixel += ((more - less) / (2 * STEP) * rays.sigma[:, axis]) ** 2
    # A residual far out tells of an error as large along the line, where nothing shows it.
    own = views.scale**2 * (TAIL + views.residual**2) / (TAIL + 1)
    slopes = _slopes(_depths, rotation, direction, rays)
    by_motion = np.einsum("ni,ij,nj->n", slopes, views.covariance, slopes)
    return np.sqrt(by_pixel * own), np.sqrt(np.maximum(by_motion, 0))


def _residuals(rotation: Array, direction: Array, rays: Rays) -> Array:
    lines = np.cross(direction, rays.first @ rotation.T)
    sigma = np.hypot(lines[:, 0] * rays.sigma[:, 0], lines[:, 1] * rays.sigma[:, 1])
    return np.asarray((lines * rays.second).sum(axis=1) / sigma)


def _depths(rotation: Array, direction: Array, rays: Rays) -> Array:
    across = np.cross(rays.first @ rotation.T, rays.second)
    shift = np.cross(rays.second, direction)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray((shift * across).sum(axis=1) / (across * across).sum(axis=1))


def _slopes(function: Any, rotation: Array, direction: Array, rays: Rays) -> Array:
    """Return (N, 5): how what `function` says changes with the motion."""
    columns = []
    for step in np.eye(5) * STEP:
        more = function(*_moved(rotation, direction, step), rays)
        less = function(*_moved(rotation, direction, -step), rays)
        columns.append((more - less) / (2 * STEP))
    return np.stack(columns, axis=1)


def _solve(slopes: Array, weight: Array, residual: Array) -> Array:
    weighted = slopes * weight[:, None]
    return np.asarray(np.linalg.lstsq(weighted.T @ slopes, weighted.T @ residual, rcond=None)[0])


def _covariance(slopes: Array, residual: Array, scale: float, first: Array) -> Array:
    """Return the covariance of an M-estimate, the larger of what all points and cells say."""
    weight = (TAIL + 1) / (TAIL + residual**2)
    bent = weight * (TAIL - residual**2) / (TAIL + residual**2)
    bend = max(float(bent.mean() / weight.mean()), 0.1)
    inverse = np.linalg.pinv((slopes * weight[:, None]).T @ slopes) / bend
    pulls = slopes * (weight * residual * scale)[:, None]
    low, high = first[:, :2].min(axis=0), first[:, :2].max(axis=0)
    cell = np.floor(CELLS * (first[:, :2] - low) / (high - low + 1e-9)).astype(int)
    _, group = np.unique(cell[:, 0] * CELLS + cell[:, 1], return_inverse=True)
    sums = np.zeros((group.max() + 1, 5))
    np.add.at(sums, group, pulls)
    spread = sums.T @ sums * (len(sums) / max(len(sums) - 5, 1))
    return np.asarray(SHARED * inverse @ (spread + pulls.T @ pulls) @ inverse)


def _spread(residual: Array) -> float:
    return max(1.4826 * float(np.median(np.abs(residual))), LEAST_SCALE)


def _moved(rotation: Array, direction: Array, step: Array) -> tuple[Array, Array]:
    turn = Transform.exp(np.concatenate([np.zeros(3), step[:3]])).matrix()[:3, :3]
    across: Array = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    across = across / np.linalg.norm(across)
    moved = direction + step[3] * across + step[4] * np.cross(direction, across)
    return turn @ rotation, moved / np.linalg.norm(moved)


def _parts(motion: Transform) -> tuple[Array, Array]:
    matrix = np.asarray(motion.matrix())
    return matrix[:3, :3], matrix[:3, 3] / np.linalg.norm(matrix[:3, 3])


def _joined(rotation: Array, direction: Array) -> Transform:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, direction
    return Transform.from_matrix(matrix)
