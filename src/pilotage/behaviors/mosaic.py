# SPDX-License-Identifier: Apache-2.0
"""Pictures of a sweep joined by homographies, as if the camera had only turned.

The Nao paper's way: homographies between neighbours by four-point RANSAC with normalised data and
linear estimation from all inliers (Hartley and Zisserman 2004, algorithm 4.6), joined by
H_ik = H_jk H_ij.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pilotage import Camera, _core
from pilotage.behaviors.sweep import Array, Features, Shared, View

FEWEST_INLIERS = 15
# A turn leaves angles between rays as they are. A map of rays that stretches one direction by more
# than this against another is no turn, whatever it fits.
MOST_STRETCH = 1.6


@dataclass(frozen=True, kw_only=True, eq=False)
class Link:
    """Two neighbours: `b_from_a` (3, 3) maps unit rays of a onto rays of b, up to a factor.

    Empty with a `reason` where they cannot be joined. `rms_px` is of the inliers, in picture b.
    """

    a: int
    b: int
    b_from_a: Array | None
    matches: int
    inliers: int
    rms_px: float
    reason: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Joined:
    """A mosaic by homographies: `middle_from_view` by view, None with one of `reasons` else."""

    middle: int
    links: list[Link]
    middle_from_view: list[Array | None]
    reasons: list[str]

    @property
    def joined(self) -> int:
        """Return how many pictures are joined."""
        return sum(map is not None for map in self.middle_from_view)


def link_views(views: Sequence[View], shared: Sequence[Shared]) -> list[Link]:
    """Return a link for each two pictures that share matches, those that fail with their reason."""
    return [_link(views, found) for found in shared if len(found.rows_a)]


def join_by_homographies(views: Sequence[View], links: Sequence[Link]) -> Joined:
    """Return the pictures joined to the one in the middle, each by its surest chain of links.

    The middle is the picture that looks most nearly straight ahead, or, where nobody told, from
    which the others are reached by the fewest links.
    """
    good = [link for link in links if link.b_from_a is not None]
    middle = _middle(views, good)
    maps = chain(good, len(views), middle)
    reasons = ["" if map is not None else _reason(i, links) for i, map in enumerate(maps)]
    return Joined(middle=middle, links=list(links), middle_from_view=maps, reasons=reasons)


def chain(links: Sequence[Link], count: int, middle: int) -> list[Array | None]:
    """Return `middle_from_view` of each view, None where no chain of links leads to the middle.

    A maximum spanning tree (Prim 1957): of all links that lead on the one with most inliers is
    taken first.
    """
    maps: list[Array | None] = [None] * count
    maps[middle] = np.eye(3)
    order = sorted(links, key=lambda link: (-link.inliers, link.rms_px))
    while True:
        for link in order:
            b_from_a, to_a, to_b = link.b_from_a, maps[link.a], maps[link.b]
            if b_from_a is None or (to_a is None) == (to_b is None):
                continue
            if to_b is not None:
                maps[link.a] = to_b @ b_from_a
            elif to_a is not None:
                maps[link.b] = to_a @ np.linalg.inv(b_from_a)
            break
        else:
            return maps


def directions_by_homographies(
    joined: Joined, features: Sequence[Features]
) -> list[NDArray[np.float64]]:
    """Return unit rays (N, 3) in the middle camera of each view's features, NaN where not joined.

    A fixed homography knows directions only: the same for near and far.
    """
    found = []
    for map_, of_view in zip(joined.middle_from_view, features, strict=True):
        found.append(
            np.full_like(of_view.rays, np.nan) if map_ is None else turned(map_, of_view.rays)
        )
    return found


def turned(map_: Array, rays: Array) -> Array:
    """Return unit rays (N, 3) mapped by (3, 3)."""
    mapped = rays @ map_.T
    return np.asarray(mapped / np.linalg.norm(mapped, axis=1, keepdims=True))


def _link(views: Sequence[View], found: Shared) -> Link:
    lens_a, lens_b = views[found.a].lens, views[found.b].lens
    pixels_a, pixels_b = _ideal(lens_a, found.pixels_a), _ideal(lens_b, found.pixels_b)
    known = np.isfinite(pixels_a).all(axis=1) & np.isfinite(pixels_b).all(axis=1)
    options = _core.HomographyOptions()
    options.min_inliers = FEWEST_INLIERS
    result = _core.find_homography(
        points_a=pixels_a[known], points_b=pixels_b[known], options=options,
        qualities=np.ascontiguousarray(found.quality[known], np.float32),
    )  # fmt: skip
    count = int(known.sum())
    map_, reason = None, ""
    if result.b_from_a is None:
        reason = f"of {count} matches no turn of the camera explains {FEWEST_INLIERS}"
    else:
        map_ = np.linalg.inv(_intrinsics(lens_b)) @ result.b_from_a @ _intrinsics(lens_a)
        map_ = map_ / np.cbrt(np.linalg.det(map_))
        stretch = float(np.linalg.cond(map_))
        if stretch > MOST_STRETCH or not math.isfinite(stretch):
            reason = (
                f"the homography of {result.inlier_count} matches stretches the picture"
                f" {stretch:.1f} times, as no turn does: the overlap is too narrow, or things are"
                " too near"
            )
            map_ = None
    return Link(
        a=found.a, b=found.b, b_from_a=map_, matches=count,
        inliers=int(result.inlier_count), rms_px=float(result.rms_px), reason=reason,
    )  # fmt: skip


def _ideal(lens: Camera, pixels: Array) -> Array:
    """Return pixels (N, 2) as a camera without distortion would show them."""
    rays = lens.unproject(np.ascontiguousarray(pixels))
    return np.ascontiguousarray((rays / rays[:, 2:] @ _intrinsics(lens).T)[:, :2])


def _intrinsics(lens: Camera) -> Array:
    return np.array([[lens.fx_px, 0, lens.cx_px], [0, lens.fy_px, lens.cy_px], [0, 0, 1]])


def _middle(views: Sequence[View], links: Sequence[Link]) -> int:
    ahead = [
        None if (told := v.stop_from_camera) is None else float(told.matrix()[0, 2]) for v in views
    ]
    if all(value is not None for value in ahead):
        return int(np.argmax(np.array(ahead)))
    count = len(views)
    hops = np.where(np.eye(count, dtype=bool), 0.0, np.inf)
    for link in links:
        hops[link.a, link.b] = hops[link.b, link.a] = 1
    for via in range(count):  # Floyd and Warshall
        hops = np.minimum(hops, hops[:, via : via + 1] + hops[via])
    reached = np.isfinite(hops).sum(axis=1)
    total = np.where(np.isfinite(hops), hops, 0).sum(axis=1)
    inliers = [sum(k.inliers for k in links if i in {k.a, k.b}) for i in range(count)]
    return min(range(count), key=lambda i: (-reached[i], total[i], -inliers[i]))


def _reason(view: int, links: Sequence[Link]) -> str:
    """Return why a picture has no chain of links: what came nearest."""
    own = [link for link in links if view in {link.a, link.b}]
    if not own:
        return "it shares nothing with any other picture"
    best = max(own, key=lambda link: (link.inliers, link.matches))
    return best.reason or "what it shares leads to no picture of the middle"
