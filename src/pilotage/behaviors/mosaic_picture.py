# SPDX-License-Identifier: Apache-2.0
"""Pictures of a sweep stitched into one: seams blended in two bands, holes inpainted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pilotage import Camera, Transform
from pilotage.behaviors.mosaic import Joined
from pilotage.behaviors.moving_centres import Refined
from pilotage.behaviors.sweep import Array, View
from pilotage.behaviors.virtual_camera import Distances

Grey = NDArray[np.uint8]
Floats = NDArray[np.float32]

COARSE_PX = 8  # lenses bend so little that places between are straight to a tenth of a pixel
OUTSIDE_PX = -1e6
LOW_BAND = 0.02  # of the width: the scale above which brightness is blended widely
GAIN_SIGMA = 0.1  # of the cameras' brightness, against each other
LEAST_SHARED_PX = 200
LOW_SCALE = 8  # the low band is worked out on a smaller copy
INPAINT_SCALE = 4  # holes are filled on a smaller copy: they hold no detail anyhow
INPAINT_RADIUS_PX = 5


@dataclass(frozen=True, kw_only=True, eq=False)
class Stitched:
    """A wide picture (height, width) uint8. `share_seen` of it pictures show, the rest is filled
    in where it lies between them (`share_filled`) and black beyond."""

    grey: Grey
    share_seen: float
    share_filled: float


def lookups_by_homographies(
    views: Sequence[View], joined: Joined, virtual: Camera, middle_from_virtual: Array
) -> list[Floats | None]:
    """Return for each view the pixels (height, width, 2) of it that the virtual camera sees.

    None for views that are not joined; outside the picture where a view does not look.
    """
    rays = _rays_of(virtual) @ middle_from_virtual.T
    return [
        None if map_ is None else _lookup(view.lens, rays @ np.linalg.inv(map_).T, virtual)
        for view, map_ in zip(views, joined.middle_from_view, strict=True)
    ]


def lookups_by_moving_centres(
    views: Sequence[View],
    refined: Refined,
    distances: Distances,
    virtual: Camera,
    stop_from_virtual: Transform,
) -> list[Floats | None]:
    """Return the same of cameras that move, things being as far as `distances` tell."""
    origin = np.asarray(stop_from_virtual.translation_m)
    ahead = _rays_of(virtual) @ stop_from_virtual.matrix()[:3, :3].T
    distance_m = distances.along(origin, ahead)[:, None]
    found: list[Floats | None] = []
    for view, pose in zip(views, refined.stop_from_camera, strict=False):
        points = origin + ahead * distance_m - pose.translation_m
        found.append(_lookup(view.lens, points @ pose.matrix()[:3, :3], virtual))
    return found


def stitch(views: Sequence[View], lookups: Sequence[Floats | None]) -> Stitched:
    """Return the views drawn at the places that `lookups` name, one at least not None."""
    drawn = [
        _drawn(view.grey, lookup)
        for view, lookup in zip(views, lookups, strict=True)
        if lookup is not None
    ]
    pictures, masks = [picture for picture, _ in drawn], [mask for _, mask in drawn]
    gains = _gains(pictures, masks)
    scaled = [gain * picture for gain, picture in zip(gains, pictures, strict=True)]
    blended = np.clip(np.rint(_blend(scaled, masks)), 0, 255).astype(np.uint8)
    seen = np.any(masks, axis=0)
    holes = _hull(seen) & ~seen
    return Stitched(
        grey=_fill(blended, seen, holes),
        share_seen=float(seen.mean()), share_filled=float(holes.mean()),
    )  # fmt: skip


def _coarse_shape(virtual: Camera) -> tuple[int, int]:
    return virtual.height_px // COARSE_PX + 2, virtual.width_px // COARSE_PX + 2


def _rays_of(virtual: Camera) -> Array:
    """Return the unit rays (N, 3) of every `COARSE_PX`-th pixel each way, row by row."""
    rows, columns = np.indices(_coarse_shape(virtual)) * float(COARSE_PX)
    return virtual.unproject(np.stack([columns.ravel(), rows.ravel()], axis=1))


def _lookup(lens: Camera, points: Array, virtual: Camera) -> Floats:
    """Return the pixels (height, width, 2) of points (N, 3), one for each of `_rays_of`."""
    pixels = lens.project(np.ascontiguousarray(points))
    # What has no place drags its neighbours out of the picture, never into it.
    coarse = np.where(np.isfinite(pixels), pixels, OUTSIDE_PX).astype(np.float32)
    coarse = coarse.reshape(*_coarse_shape(virtual), 2)
    rows, columns = np.indices((virtual.height_px, virtual.width_px), np.float32) / COARSE_PX
    return np.asarray(cv2.remap(coarse, columns, rows, cv2.INTER_LINEAR), np.float32)


def _drawn(grey: Grey, lookup: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    height, width = grey.shape
    x, y = lookup[..., 0], lookup[..., 1]
    mask = (x >= 0) & (y >= 0) & (x <= width - 1) & (y <= height - 1)
    picture = cv2.remap(grey.astype(np.float32), x, y, cv2.INTER_LINEAR)
    return np.where(mask, picture, 0).astype(np.float32), mask


def _gains(pictures: Sequence[Floats], masks: Sequence[NDArray[np.bool_]]) -> Array:
    """Return what each picture's brightness is to be multiplied with, so that overlaps are alike.

    Least squares of the logarithms, held near 1 (after Brown and Lowe 2007, section 6).
    """
    count = len(pictures)
    rows, values = [np.eye(count) / GAIN_SIGMA], [np.zeros(count)]
    for a in range(count):
        for b in range(a + 1, count):
            both = masks[a] & masks[b]
            if both.sum() < LEAST_SHARED_PX:
                continue
            level_a, level_b = (max(float(pictures[i][both].mean()), 1.0) for i in (a, b))
            row = np.zeros((1, count))
            row[0, [a, b]] = 1 / 0.01, -1 / 0.01
            rows.append(row)
            values.append(np.array([np.log(level_b / level_a) / 0.01]))
    solved = np.linalg.lstsq(np.vstack(rows), np.concatenate(values), rcond=None)[0]
    return np.asarray(np.exp(solved))


def _blend(pictures: Sequence[Floats], masks: Sequence[NDArray[np.bool_]]) -> Floats:
    """Return low frequencies mixed by the distance to each picture's edge, high ones of the best.

    Two bands of multi-band blending (Burt and Adelson 1983): no seam in brightness, and detail
    that does not coincide is not drawn twice.
    """
    best = np.zeros(masks[0].shape, np.float32)
    detail, low_sum, total = (np.zeros_like(best) for _ in range(3))
    for picture, mask in zip(pictures, masks, strict=True):
        inside = np.pad(mask.astype(np.uint8), 1)
        depth = cv2.distanceTransform(inside, cv2.DIST_L2, 5)[1:-1, 1:-1].astype(np.float32)
        low = _low_band(picture, mask)
        is_best = depth > best
        detail[is_best] = (picture - low)[is_best]
        best[is_best] = depth[is_best]
        low_sum += depth * low
        total += depth
    return np.where(total > 0, low_sum / np.maximum(total, 1e-6) + detail, 0).astype(np.float32)


def _low_band(picture: Floats, mask: NDArray[np.bool_]) -> Floats:
    """Return the picture smoothed, as if there were nothing beyond its mask."""
    height, width = mask.shape
    size = (max(1, width // LOW_SCALE), max(1, height // LOW_SCALE))
    sigma = max(1.0, LOW_BAND * width / LOW_SCALE)
    layers = np.dstack([picture, mask.astype(np.float32)])
    small = cv2.GaussianBlur(cv2.resize(layers, size, interpolation=cv2.INTER_AREA), (0, 0), sigma)
    level = small[..., 0] / np.maximum(small[..., 1], 1e-6)
    return np.asarray(cv2.resize(level, (width, height), interpolation=cv2.INTER_LINEAR))


def _hull(seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    points = cv2.findNonZero(seen.astype(np.uint8))
    filled = np.zeros(seen.shape, np.uint8)
    if points is not None:
        cv2.fillConvexPoly(filled, cv2.convexHull(points), 1)
    return filled.astype(bool)


def _fill(grey: Grey, seen: NDArray[np.bool_], holes: NDArray[np.bool_]) -> Grey:
    if not holes.any():
        return grey
    size = tuple(max(1, side // INPAINT_SCALE) for side in grey.shape[::-1])
    # Averages of what is seen only: black must not leak in.
    weight = cv2.resize(seen.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    level = cv2.resize(np.where(seen, grey, 0).astype(np.float32), size,
                       interpolation=cv2.INTER_AREA)  # fmt: skip
    small = np.rint(level / np.maximum(weight, 1e-3)).clip(0, 255).astype(np.uint8)
    missing = (weight < 0.5).astype(np.uint8)
    small = np.asarray(cv2.inpaint(small, missing, INPAINT_RADIUS_PX, cv2.INPAINT_TELEA))
    large = cv2.resize(small, grey.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return np.where(holes, large, grey).astype(np.uint8)
