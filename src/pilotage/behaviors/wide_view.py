# SPDX-License-Identifier: Apache-2.0
"""The recipe of a wide view: features of a sweep, summed as one camera would see them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pilotage import Camera
from pilotage.behaviors.mosaic import (
    Joined,
    directions_by_homographies,
    join_by_homographies,
    link_views,
)
from pilotage.behaviors.mosaic_picture import (
    Stitched,
    lookups_by_homographies,
    lookups_by_moving_centres,
    stitch,
)
from pilotage.behaviors.moving_centres import Refined, refine_sweep
from pilotage.behaviors.sweep import Array, Features, View, find_features, find_shared
from pilotage.behaviors.virtual_camera import (
    Seen,
    distances_of,
    see_features,
    straight_ahead,
    virtual_lens,
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Moving:
    """The model with moving centres: poses and points, each view's features, the wide picture."""

    refined: Refined
    seen: list[Seen]
    pixels: list[Array]
    stitched: Stitched


@dataclass(frozen=True, kw_only=True, eq=False)
class WideView:
    """A sweep seen by one `virtual` camera. `fixed_px` are by view the pixels (N, 2) of its
    `features` by homographies, NaN where a view is not joined or looks behind; `stitched` is None
    where no two pictures could be joined, `moving` where the robot told no head angles.
    """

    views: Sequence[View]
    features: list[Features]
    joined: Joined
    virtual: Camera
    fixed_px: list[Array]
    stitched: Stitched | None
    moving: Moving | None


def look_wide(
    views: Sequence[View], *, others: Sequence[View] = (), floor_z_m: float | None = None
) -> WideView:
    """Return the wide view of two pictures or more, of one place in several directions.

    `others` are pictures of a crouch: they are not drawn, but tell how far things are. floor_z_m
    is the floor's height in the frame `stop`, metres, where it is known.
    """
    count, together = len(views), [*views, *others]
    of_all = [find_features(view) for view in together]
    features, shared = of_all[:count], find_shared(together, of_all)
    drawn = [found for found in shared if max(found.a, found.b) < count]
    joined = join_by_homographies(views, link_views(views, drawn))
    fixed = directions_by_homographies(joined, features)
    lens = views[joined.middle].lens
    if any(view.stop_from_camera is None for view in together):
        virtual = virtual_lens(lens, _known(fixed))
        return _with_homographies(views, features, joined, fixed, virtual, np.eye(3), None)
    refined = refine_sweep(together, shared)
    distances = distances_of(refined, joined.middle, floor_z_m)
    seen = see_features(features, shared, refined, distances)
    middle = refined.stop_from_camera[joined.middle]
    stop_from_virtual = straight_ahead(middle)
    turn = stop_from_virtual.matrix()[:3, :3]
    ahead = [of_view.directions @ turn for of_view in seen]
    middle_from_virtual = middle.matrix()[:3, :3].T @ turn
    virtual = virtual_lens(lens, np.concatenate([*ahead, _known(fixed) @ middle_from_virtual]))
    lookups = lookups_by_moving_centres(views, refined, distances, virtual, stop_from_virtual)
    moving = Moving(
        refined=refined, seen=seen, pixels=[_project(virtual, rays) for rays in ahead],
        stitched=stitch(views, lookups),
    )  # fmt: skip
    return _with_homographies(views, features, joined, fixed, virtual, middle_from_virtual, moving)


def _with_homographies(  # noqa: PLR0913, PLR0917, all that a wide view is made of
    views: Sequence[View],
    features: list[Features],
    joined: Joined,
    fixed: list[Array],
    virtual: Camera,
    middle_from_virtual: Array,
    moving: Moving | None,
) -> WideView:
    stitched = None
    if joined.joined > 1:
        lookups = lookups_by_homographies(views, joined, virtual, middle_from_virtual)
        stitched = stitch(views, lookups)
    return WideView(
        views=views, features=features, joined=joined, virtual=virtual,
        fixed_px=[_project(virtual, rays @ middle_from_virtual) for rays in fixed],
        stitched=stitched, moving=moving,
    )  # fmt: skip


def _known(directions: Sequence[Array]) -> Array:
    rays = np.concatenate(list(directions))
    return np.asarray(rays[np.isfinite(rays).all(axis=1)])


def _project(virtual: Camera, rays: Array) -> Array:
    return virtual.project(np.ascontiguousarray(rays))
