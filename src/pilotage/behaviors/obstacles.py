# SPDX-License-Identifier: Apache-2.0
"""What measured points say of a place in the picture, of the ground, and of what stands on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pilotage.behaviors.depth import Array, Depth
from pilotage.errors import InputError

NEAR_SHARE = 0.04  # of the picture's diagonal: points further away say nothing of a pixel
NEAREST_SHARE = 0.02  # the nearest one must be nearer than this
NEIGHBOURS = 8
PER_PX = 0.005  # relative error for each pixel to the nearest point: there may be an edge between
CLOSE_PX = 4.0  # a point nearer than this is not nearer still
JUMP = 0.25  # relative differences of inverse depth beyond this are an edge
STEEPEST = 0.02  # of inverse depth, in parts of it per pixel: what slopes are held towards

DOWN = (0.0, 1.0, 0.0)  # in an upright camera
GROUND_TILT_RAD = math.radians(20)
GROUND_TRIES = 400
GROUND_WITHIN_M = 0.03
FEWEST_GROUND = 12
CAMERA_HEIGHT_TOLERANCE = 0.2
STANDS_OUT_M = 0.05
FEWEST_OF_OBSTACLE = 3
GAP_M = 0.25  # between points of one obstacle, on the ground
CERTAIN_SIGMA = 2.0


@dataclass(frozen=True, kw_only=True)
class PixelDistance:
    """Distance of what a pixel shows, along its ray, with its standard error; else the reason."""

    distance_m: float | None
    sigma_m: float | None
    reason: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Ground:
    """The plane under the camera: points p of the first camera with up . p + height_m = 0."""

    up: Array
    height_m: float


@dataclass(frozen=True, kw_only=True)
class Obstacle:
    """Something on the ground: where its nearest point is, as seen from the camera.

    `distance_m` is along the ground, `bearing_rad` positive to the left, `height_m` that of its
    highest point.
    """

    distance_m: float
    distance_sigma_m: float
    bearing_rad: float
    height_m: float
    points: int


def distance_at(depth: Depth, pixel: tuple[float, float]) -> PixelDistance:
    """Return the distance of what lies under `pixel` (x, y) of the first picture.

    A plane through the nearest points, flat in inverse depth as planes are; where they disagree, at
    an edge, the standard error says so.
    """
    if not depth.is_good:
        return PixelDistance(distance_m=None, sigma_m=None, reason=depth.reason)
    camera, at = depth.camera, np.asarray(pixel, dtype=np.float64)
    if not (-0.5 <= at[0] <= camera.width_px - 0.5 and -0.5 <= at[1] <= camera.height_px - 0.5):
        raise InputError(
            f"pixel {at[0]:g},{at[1]:g}: outside the picture, {camera.width_px}x{camera.height_px}"
        )
    diagonal = math.hypot(camera.width_px, camera.height_px)
    away = np.linalg.norm(depth.pixels - at, axis=1)
    nearest = np.argsort(away, kind="stable")[:NEIGHBOURS]
    nearest = nearest[away[nearest] < NEAR_SHARE * diagonal]
    if not len(nearest) or away[nearest[0]] > NEAREST_SHARE * diagonal:
        return PixelDistance(
            distance_m=None, sigma_m=None, reason="nothing was measured near this pixel"
        )
    inverse, sigma = _inverse_depth(depth, at, nearest, away[nearest])
    sigma = math.hypot(sigma, PER_PX * float(away[nearest[0]]) * inverse)
    if inverse <= CERTAIN_SIGMA * sigma:
        return PixelDistance(
            distance_m=None, sigma_m=None, reason="the points near this pixel contradict each other"
        )
    ray = camera.unproject(at[None])[0]
    along = float(1 / (ray[2] * inverse))
    return PixelDistance(distance_m=along, sigma_m=float(along * sigma / inverse))


def _inverse_depth(depth: Depth, at: Array, near: Array, away: Array) -> tuple[float, float]:
    """Return inverse depth at a pixel and its standard error, by weighted least squares."""
    value = 1 / depth.depth_m[near]
    sigma = value * depth.depth_sigma_m[near] / depth.depth_m[near]
    weight = 1 / (away**2 + CLOSE_PX**2)
    weight /= weight.sum()
    offset = depth.pixels[near] - at
    design = np.column_stack([np.ones(len(near)), offset])
    held = np.diag([0.0, *([1 / CLOSE_PX**2] * 2)]) * 1e-6 / STEEPEST**2
    normal = (design * weight[:, None]).T @ design + held
    share = np.linalg.solve(normal, (design * weight[:, None]).T)[0]
    inverse = float(share @ value)
    fitted = design @ np.linalg.solve(normal, (design * weight[:, None]).T @ value)
    scatter = float(np.sqrt(weight @ (value - fitted) ** 2))
    middle = float(np.median(value))
    if np.ptp(value) > JUMP * middle:  # neighbours on two things: either may be what is seen
        scatter = max(scatter, float(np.sqrt(np.mean((value - middle) ** 2))))
    # The motion's error is common to all of them: their mean is no better than one of them.
    return inverse, math.hypot(float(np.abs(share) @ sigma / np.abs(share).sum()), scatter)


def find_ground(
    depth: Depth, *, camera_height_m: float | None = None, down: tuple[float, float, float] = DOWN
) -> Ground | None:
    """Return the plane that most points below the camera lie in, None where no plane is seen.

    `down` is where down is in the first camera, to 20 degrees; `camera_height_m`, where known,
    must agree to a fifth.
    """
    upward = -np.asarray(down) / np.linalg.norm(down)
    below = depth.points_m[depth.points_m @ upward < -GROUND_WITHIN_M]
    if len(below) < FEWEST_GROUND:
        return None
    random = np.random.default_rng(1)
    best, most = None, FEWEST_GROUND - 1
    for _ in range(GROUND_TRIES):
        plane = _plane(below[random.choice(len(below), 3, replace=False)], upward)
        if plane is None or not _is_ground(plane, upward, camera_height_m):
            continue
        count = int((np.abs(_heights(plane, below)) < _tolerance(below)).sum())
        if count > most:
            best, most = plane, count
    if best is None:
        return None
    refined = _plane(below[np.abs(_heights(best, below)) < _tolerance(below)], upward)
    return refined if refined and _is_ground(refined, upward, camera_height_m) else best


def find_obstacles(depth: Depth, ground: Ground) -> list[Obstacle]:
    """Return what stands out of the ground by more than 5 cm, nearest first."""
    height = _heights(ground, depth.points_m)
    distrust = (
        CERTAIN_SIGMA * depth.depth_sigma_m * np.abs(depth.points_m @ ground.up / depth.depth_m)
    )
    stands = np.flatnonzero(height > STANDS_OUT_M + distrust)
    ahead = np.array([0.0, 0.0, 1.0]) - ground.up * ground.up[2]
    ahead /= np.linalg.norm(ahead)
    left = np.cross(ground.up, ahead)
    floor = np.column_stack([depth.points_m[stands] @ ahead, depth.points_m[stands] @ left])
    found = []
    for rows in _clusters(floor):
        if len(rows) < FEWEST_OF_OBSTACLE:
            continue
        away = np.linalg.norm(floor[rows], axis=1)
        # Not the very nearest point, which may be a wrong match.
        near = rows[np.argsort(away)[FEWEST_OF_OBSTACLE // 2]]
        found.append(
            Obstacle(
                distance_m=float(np.linalg.norm(floor[near])),
                distance_sigma_m=float(depth.depth_sigma_m[stands[near]]),
                bearing_rad=math.atan2(floor[near, 1], floor[near, 0]),
                height_m=float(height[stands[rows]].max()),
                points=len(rows),
            )
        )
    return sorted(found, key=lambda obstacle: obstacle.distance_m)


def _clusters(floor: Array) -> list[Array]:
    """Return rows (N, 2) joined over gaps that grow with distance, as errors do."""
    left, groups = set(range(len(floor))), []
    reach = GAP_M * np.maximum(1, np.linalg.norm(floor, axis=1) / 3) if len(floor) else floor
    while left:
        group, waiting = [], [left.pop()]
        while waiting:
            row = waiting.pop()
            group.append(row)
            close = np.linalg.norm(floor - floor[row], axis=1) < reach[row]
            joined = left.intersection(np.flatnonzero(close).tolist())
            left -= joined
            waiting += joined
        groups.append(np.array(sorted(group)))
    return groups


def _heights(ground: Ground, points_m: Array) -> Array:
    return np.asarray(points_m @ ground.up + ground.height_m)


def _tolerance(points_m: Array) -> Array:
    return GROUND_WITHIN_M * np.maximum(1, points_m[:, 2] / 3)


def _plane(points_m: Array, upward: Array) -> Ground | None:
    middle = points_m.mean(axis=0)
    up = np.linalg.svd(points_m - middle)[2][2] if len(points_m) >= 3 else np.zeros(3)
    up = up * np.sign(up @ upward)
    return Ground(up=up, height_m=float(-middle @ up)) if np.any(up) else None


def _is_ground(plane: Ground, upward: Array, camera_height_m: float | None) -> bool:
    if plane.up @ upward < math.cos(GROUND_TILT_RAD) or plane.height_m < GROUND_WITHIN_M:
        return False
    if camera_height_m is None:
        return True
    return abs(plane.height_m - camera_height_m) < CAMERA_HEIGHT_TOLERANCE * camera_height_m
