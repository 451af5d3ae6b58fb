# SPDX-License-Identifier: Apache-2.0
"""Pictures that a model puts beside others, though they show nothing of what those show there.

Mirrored pictures of something that is like its mirror image, or pictures of a second thing that
looks like the first, are tied to the others by the few points that both have in common. Neighbours
that really look at one thing share a good part of their points.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from pilotage.models import Model

# Pictures so much alike in place and direction that what one shows the other must show as well.
NEAREST = 12  # pictures that each is compared with
LOOK_ALIKE = math.cos(math.radians(45))
SAME_SIDE = math.cos(math.radians(10))  # a point is seen from one side
SAME_SIZE = 1.25  # and as large, up to this factor
MARGIN = 0.05  # of the picture: points at its edge may be missed
FEWEST = 50  # points, with less two pictures say nothing about each other
# Of a rendered room's neighbours half share more than 0.55 of such points: one link of this much
# joins a picture to a group, and groups that share less than half of that contradict each other.
SHARED = 0.25
MISSED = 0.1
FEWEST_MISSED = 300  # points due between groups


def disjoint_views(model: Model) -> list[int]:
    """Return the pictures (indices) of the smaller groups that share no points with the largest.

    Empty where nothing contradicts the model: groups that see different things, or the same from
    different sides, may well share nothing.
    """
    pairs = [pair for pair in _neighbours(model) if pair[2] >= FEWEST]
    if not pairs:
        return []
    group = _groups(len(model.names), [(a, b) for a, b, due, seen in pairs if seen >= SHARED * due])
    across = [pair for pair in pairs if group[pair[0]] != group[pair[1]]]
    due, seen = np.sum([pair[2:] for pair in across], axis=0) if across else (0, 0)
    if due < FEWEST_MISSED or seen >= MISSED * due:
        return []
    largest = np.bincount(group).argmax()
    return sorted(
        {picture for a, b, *_ in across for picture in (a, b) if group[picture] != largest}
    )


def _neighbours(model: Model) -> list[tuple[int, int, int, int]]:
    """Return of neighbours a, b how many points of a are due in b, and how many b shows."""
    poses = model.world_from_camera()
    order = np.argsort(model.picture, kind="stable")
    ends = np.searchsorted(model.picture[order], np.arange(len(poses) + 1))
    shown = [np.unique(model.point[order[i:j]]) for i, j in itertools.pairwise(ends)]
    pairs = []
    for b, pose in enumerate(poses):
        away = np.linalg.norm(poses[:, :3, 3] - pose[:3, 3], axis=1)
        away[(poses[:, :3, 2] @ pose[:3, 2] < LOOK_ALIKE) | (np.arange(len(poses)) == b)] = np.inf
        for a in np.argsort(away, kind="stable")[:NEAREST].tolist():
            if math.isfinite(away[a]):
                due = shown[a][_is_due(model, poses, shown[a], a, b)]
                # A blurred picture shows few points at all, and no more can be due.
                most = min(len(due), len(shown[b]))
                pairs.append((a, b, most, int(np.isin(due, shown[b]).sum())))
    return pairs


def _is_due(
    model: Model, poses: NDArray[np.float64], points: NDArray[np.int64], a: int, b: int
) -> NDArray[np.bool_]:
    """Tell of points of a whether b would see them well inside, from the same side, as large."""
    camera, places = model.camera_of(b), model.points_in_world[points]
    from_a, from_b = places - poses[a, :3, 3], places - poses[b, :3, 3]
    in_camera = np.ascontiguousarray(from_b @ poses[b, :3, :3])
    part = (camera.project(in_camera) + 0.5) / (camera.width_px, camera.height_px)
    is_inside = (in_camera[:, 2] > 0) & ((part > MARGIN) & (part < 1 - MARGIN)).all(axis=1)
    far_a, far_b = np.linalg.norm(from_a, axis=1), np.linalg.norm(from_b, axis=1)
    is_same = (from_a * from_b).sum(axis=1) > SAME_SIDE * far_a * far_b
    is_same &= np.maximum(far_a, far_b) < SAME_SIZE * np.minimum(far_a, far_b)
    return np.asarray(is_inside & is_same)


def _groups(count: int, links: list[tuple[int, int]]) -> NDArray[np.intp]:
    """Return a number (count,) for each picture, alike where links join them."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    a, b = np.array(links, dtype=int).reshape(-1, 2).T
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])
