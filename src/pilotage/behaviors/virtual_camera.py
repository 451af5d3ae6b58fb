# SPDX-License-Identifier: Apache-2.0
"""One camera that never was: it looks straight ahead and sees what a sweep of the head saw.

It stands where the sweep's middle picture was taken. How far a thing is decides where it sees it:
the other pictures were taken centimetres aside.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pilotage import Camera, Transform
from pilotage.behaviors.moving_centres import FURTHEST_M, NEAREST_M, Refined
from pilotage.behaviors.sweep import Array, Features, Shared

WIDEST = 2.2  # tangent of half the field of view, each way: beyond, pictures are smeared out
# Chosen on rendered rooms with things at 1 to 5 m side by side.
NEARBY_RAD = math.radians(1)  # points nearer than this to a direction count alike
STEEPNESS = 2.5  # the weight falls with the angle to the power of minus twice this
UPWARD = 0.15  # things are higher than wide: an angle up counts as so much of one aside
FLOOR_M = 0.05  # points lower than this are of the floor
GUESSED_M = 3.0  # where nothing at all was measured
MOST_NEAR = 60  # points that say how far something is


@dataclass(frozen=True, kw_only=True, eq=False)
class Distances:
    """How far things are in any direction from a centre in the frame `stop`.

    Measured points say it, each for the directions near it: as columns, for most things stand
    upright; the floor, where it is known, ends every ray that goes down.
    """

    centre: Array
    places: Array  # (N, 2) of the points, see `_places`
    level_m: Array  # (N,) along the floor
    weight: Array
    floor_z_m: float | None

    def along(self, origin: Array, directions: Array) -> Array:
        """Return the distances (N,) from `origin` (3,) along unit `directions` (N, 3), metres."""
        found = self._along(origin, directions)
        return np.asarray(np.clip(found, NEAREST_M, FURTHEST_M))

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.places)

    def _along(self, origin: Array, directions: Array) -> Array:
        level = np.maximum(np.hypot(directions[:, 0], directions[:, 1]), 1e-9)
        found = np.full(len(directions), GUESSED_M)
        if len(self.level_m):
            places = _places(directions)
            count = min(MOST_NEAR, len(self.level_m))
            apart, rows = self._tree.query(places, count)
            apart, rows = apart.reshape(-1, count), rows.reshape(-1, count)
            weight = self.weight[rows] / (apart**2 + NEARBY_RAD**2) ** STEEPNESS
            nearer_m = directions[:, :2] @ (self.centre - origin)[:2] / level
            found = (_weighted_median(self.level_m[rows], weight) + nearer_m) / level
        if self.floor_z_m is not None:
            down = np.maximum(-directions[:, 2], 1e-9)
            found = np.minimum(found, (origin[2] - self.floor_z_m) / down)
        return found


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """Features of one picture in the virtual camera.

    Unit `directions` (N, 3) in the frame `stop`, as seen from the middle picture's place;
    `distance_m` (N,) from there, measured where `is_measured`, else that of what is near.
    """

    directions: Array
    distance_m: Array
    is_measured: NDArray[np.bool_]


def distances_of(refined: Refined, middle: int, floor_z_m: float | None) -> Distances:
    """Return what a sweep's points tell of distances from the place of its middle picture.

    floor_z_m is the floor's height in the frame `stop`, None where nobody knows it.
    """
    centre = np.asarray(refined.stop_from_camera[middle].translation_m)
    points = refined.points_in_stop
    stands = np.ones(len(points), bool)
    if floor_z_m is not None:
        stands = points[:, 2] > floor_z_m + FLOOR_M
    away = points[stands] - centre
    level_m = np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-6)
    level_m = np.clip(level_m, NEAREST_M, FURTHEST_M)
    sigma = np.hypot(refined.inverse_sigma[stands], 0.05 / level_m)  # no neighbour is quite alike
    return Distances(
        centre=centre,
        places=_places(away),
        level_m=level_m, weight=(0.05 / level_m / sigma)**2,
        floor_z_m=floor_z_m,
    )  # fmt: skip


def see_features(
    features: Sequence[Features],
    shared: Sequence[Shared],
    refined: Refined,
    distances: Distances,
) -> list[Seen]:
    """Return where the virtual camera sees each view's features."""
    seen = []
    for number, of_view in enumerate(features):
        pose = refined.stop_from_camera[number]
        ahead = of_view.rays @ pose.matrix()[:3, :3].T
        origin = np.asarray(pose.translation_m)
        points = origin + ahead * distances.along(origin, ahead)[:, None]
        measured = _measured(number, len(ahead), shared, refined)
        known = np.isfinite(measured)
        points[known] = origin + ahead[known] * measured[known, None]
        away = points - distances.centre
        length = np.linalg.norm(away, axis=1)
        seen.append(Seen(directions=away / length[:, None], distance_m=length, is_measured=known))
    return seen


def _measured(
    view: int, count: int, shared: Sequence[Shared], refined: Refined
) -> NDArray[np.float64]:
    """Return the distances (N,) of a view's features from its camera, NaN where not measured."""
    centre = np.asarray(refined.stop_from_camera[view].translation_m)
    length = np.linalg.norm(refined.points_in_stop - centre, axis=1)
    length = np.clip(length, NEAREST_M, FURTHEST_M)  # beyond it is as good as at infinity
    total, weight = np.zeros(count), np.zeros(count)
    for number, found in enumerate(shared):
        rows = found.rows_a if found.a == view else found.rows_b if found.b == view else None
        if rows is None:
            continue
        mine = refined.shared == number
        at, sure = rows[refined.row[mine]], 1 / refined.inverse_sigma[mine] ** 2
        np.add.at(total, at, sure / length[mine])
        np.add.at(weight, at, sure)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(weight / total)


def straight_ahead(middle: Transform) -> Transform:
    """Return `stop_from_virtual`: at the middle picture's place, looking along the torso's x."""
    return Transform(
        translation_m=middle.translation_m.tolist(), quaternion_wxyz=[0.5, -0.5, 0.5, -0.5]
    )


def virtual_lens(lens: Camera, rays: Array) -> Camera:
    """Return the pinhole, with the focal length of `lens`, that sees rays (N, 3) of its own.

    At most `WIDEST` to each side; rays are unit length, those behind it are left out.
    """
    ahead = rays[rays[:, 2] > 1e-3]
    slopes = ahead[:, :2] / ahead[:, 2:] if len(ahead) else np.zeros((1, 2))
    low, high = np.clip(slopes.min(axis=0), -WIDEST, 0), np.clip(slopes.max(axis=0), 0, WIDEST)
    first = np.floor(low * lens.fx_px)
    size = np.ceil(high * lens.fx_px) - first + 1
    return Camera(
        width_px=int(size[0]), height_px=int(size[1]), fx_px=lens.fx_px, fy_px=lens.fx_px,
        cx_px=float(-first[0]), cy_px=float(-first[1]),
    )  # fmt: skip


def _places(directions: Array) -> Array:
    """Return bearing and lessened elevation (N, 2), rad: near each other, things are alike.

    Bearings jump behind the robot, where no sweep looks.
    """
    level = np.hypot(directions[:, 0], directions[:, 1])
    bearing = np.arctan2(directions[:, 1], directions[:, 0])
    return np.stack([bearing, UPWARD * np.arctan2(directions[:, 2], level)], axis=1)


def _weighted_median(values: Array, weight: Array) -> Array:
    """Return the weighted median of each row of values (N, M) with weights (N, M)."""
    order = np.argsort(values, axis=1)
    total = np.cumsum(np.take_along_axis(weight, order, axis=1), axis=1)
    middle = (total < 0.5 * total[:, -1:]).sum(axis=1, keepdims=True)
    chosen = np.take_along_axis(order, np.minimum(middle, values.shape[1] - 1), axis=1)
    return np.asarray(np.take_along_axis(values, chosen, axis=1)[:, 0])
