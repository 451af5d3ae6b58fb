# SPDX-License-Identifier: Apache-2.0
"""The geometry of two pictures refined, and the depths it gives, with honest standard errors.

Rays are (N, 3) with z = 1, each in its own camera; the baseline is the unit of length.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pilotage import Transform

Array = NDArray[np.float64]

ROUNDS = 40
SETTLING_ROUNDS = 6  # in which the residuals' scale may still change
STEP = 1e-6
LOOSE_SIGMA = 2.5  # residuals beyond this many standard errors count little
TAIL = 3.0  # freedom of the Student distribution that the residuals follow
CELLS = 8  # the picture's sides are cut into so many, to let near errors be alike
FINEST = 2e-5  # rad: no measured pixel is better than a hundredth or so


@dataclass(frozen=True, kw_only=True, eq=False)
class TwoViews:
    """Where the second camera was, seen from the first, the distance of the two being 1.

    `covariance` (5, 5): three rotations (left perturbation, rad) and two of the direction, rad.
    `sigma` is the standard error of a coordinate of the second rays, `residual` (N,) the distance
    of each from its epipolar line, both on the plane z = 1.
    """

    second_from_first: Transform
    covariance: Array
    sigma: float
    residual: Array


def refine_two_views(first: Array, second: Array, start: Transform) -> TwoViews:
    """Return the motion that leaves the least distances from epipolar lines, blunders aside.

    The covariance takes errors of neighbouring points as one: a surface that moved, or a blob that
    looks different from elsewhere, shifts many alike.
    """
    rotation, direction = _parts(start)
    residual = _residuals(rotation, direction, first, second)
    sigma = _spread(residual)
    jacobian = np.empty((len(first), 5))
    weight = np.ones(len(first))
    for turn in range(ROUNDS):
        jacobian = _slopes(_residuals, rotation, direction, first, second)
        weight = (1 + (residual / (LOOSE_SIGMA * sigma)) ** 2) ** -2
        step = -_solve(jacobian, weight, residual)
        rotation, direction = _moved(rotation, direction, step)
        residual = _residuals(rotation, direction, first, second)
        if turn < SETTLING_ROUNDS:
            sigma = _spread(residual)
        elif np.linalg.norm(step) < STEP:
            break
    return TwoViews(
        second_from_first=_joined(rotation, direction),
        covariance=_covariance(jacobian, weight, residual, sigma, first),
        sigma=sigma,
        residual=residual,
    )


def depths(second_from_first: Transform, first: Array, second: Array) -> Array:
    """Return (N,) depths in the first camera, negative where rays meet behind it."""
    return _depths(*_parts(second_from_first), first, second)


def depth_errors(views: TwoViews, first: Array, second: Array) -> tuple[Array, Array]:
    """Return the standard errors (N,) of the depths that pixels and the motion leave, apart."""
    rotation, direction = _parts(views.second_from_first)
    by_pixel = np.zeros(len(first))
    for axis in range(2):
        shift = np.zeros(3)
        shift[axis] = STEP
        more = _depths(rotation, direction, first, second + shift)
        less = _depths(rotation, direction, first, second - shift)
        by_pixel += ((more - less) / (2 * STEP)) ** 2
    # A residual far out tells of an error as large along the line, where nothing shows it.
    own = (TAIL + (views.residual / views.sigma) ** 2) / (TAIL + 1)
    slopes = _slopes(_depths, rotation, direction, first, second)
    by_motion = np.einsum("ni,ij,nj->n", slopes, views.covariance, slopes)
    return views.sigma * np.sqrt(by_pixel * own), np.sqrt(np.maximum(by_motion, 0))


def _residuals(rotation: Array, direction: Array, first: Array, second: Array) -> Array:
    lines = np.cross(direction, first @ rotation.T)
    return np.asarray((lines * second).sum(axis=1) / np.hypot(lines[:, 0], lines[:, 1]))


def _depths(rotation: Array, direction: Array, first: Array, second: Array) -> Array:
    across = np.cross(first @ rotation.T, second)
    shift = np.cross(second, direction)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray((shift * across).sum(axis=1) / (across * across).sum(axis=1))


def _slopes(function: Any, rotation: Array, direction: Array, *rays: Array) -> Array:
    """Return (N, 5): how what `function` says changes with the motion."""
    columns = []
    for step in np.eye(5) * STEP:
        more = function(*_moved(rotation, direction, step), *rays)
        less = function(*_moved(rotation, direction, -step), *rays)
        columns.append((more - less) / (2 * STEP))
    return np.stack(columns, axis=1)


def _solve(jacobian: Array, weight: Array, residual: Array) -> Array:
    weighted = jacobian * weight[:, None]
    return np.linalg.lstsq(weighted.T @ jacobian, weighted.T @ residual, rcond=None)[0]


def _covariance(
    jacobian: Array, weight: Array, residual: Array, sigma: float, first: Array
) -> Array:
    inverse = np.linalg.pinv((jacobian * weight[:, None]).T @ jacobian)
    pulls = jacobian * (weight * residual)[:, None]
    low, high = first[:, :2].min(axis=0), first[:, :2].max(axis=0)
    cell = np.floor(CELLS * (first[:, :2] - low) / (high - low + 1e-9)).astype(int)
    _, group = np.unique(cell[:, 0] * CELLS + cell[:, 1], return_inverse=True)
    sums = np.zeros((group.max() + 1, 5))
    np.add.at(sums, group, pulls)
    count = len(sums)
    spread = sums.T @ sums * (count / max(count - 5, 1))
    return np.asarray(inverse @ spread @ inverse + sigma**2 * inverse)


def _spread(residual: Array) -> float:
    return max(1.4826 * float(np.median(np.abs(residual))), FINEST)


def _moved(rotation: Array, direction: Array, step: Array) -> tuple[Array, Array]:
    turn = Transform.exp(np.concatenate([np.zeros(3), step[:3]])).matrix()[:3, :3]
    across = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    across /= np.linalg.norm(across)
    moved = direction + step[3] * across + step[4] * np.cross(direction, across)
    return turn @ rotation, moved / np.linalg.norm(moved)


def _parts(motion: Transform) -> tuple[Array, Array]:
    matrix = np.asarray(motion.matrix())
    return matrix[:3, :3], matrix[:3, 3] / np.linalg.norm(matrix[:3, 3])


def _joined(rotation: Array, direction: Array) -> Transform:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, direction
    return Transform.from_matrix(matrix)
