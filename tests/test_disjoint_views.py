# SPDX-License-Identifier: Apache-2.0
"""Pictures that share nothing with those beside them are told from pictures of other things."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic_models import camera

from pilotage import Transform
from pilotage.behaviors.disjoint_views import disjoint_views
from pilotage.models import Model

PICTURES, POINTS = 8, 900


def a_row(seen: np.ndarray, *, turned: tuple[int, ...] = ()) -> Model:
    """Return pictures 0.1 apart before a wall that show points by `seen` (PICTURES, POINTS).

    Those in `turned` look the other way.
    """
    random = np.random.default_rng(4)
    lens = camera()
    picture, point = np.nonzero(seen)
    poses = [
        Transform(
            translation_m=(0.1 * i, 0, 0) if i in turned else (-0.1 * i, 0, 0),
            quaternion_wxyz=(0.0, 0.0, 1.0, 0.0) if i in turned else (1.0, 0.0, 0.0, 0.0),
        )
        for i in range(PICTURES)
    ]
    return Model(
        cameras=(lens,),
        names=tuple(f"{i}.jpg" for i in range(PICTURES)),
        camera_index=np.zeros(PICTURES, np.int64),
        camera_from_world=tuple(poses),
        points_in_world=random.uniform((-1, -1, 5), (1.5, 1, 6), (POINTS, 3)),
        colors=np.zeros((POINTS, 3), np.uint8),
        picture=picture,
        point=point,
        pixel_px=np.zeros((len(point), 2)),
    )


def shown(share: float) -> np.ndarray:
    """Return which of all points each picture shows, at random."""
    return np.random.default_rng(7).random((PICTURES, POINTS)) < share


def test_neighbours_that_share_half_of_their_points_fit():
    assert disjoint_views(a_row(shown(0.5))) == []


@pytest.mark.parametrize("strangers", [(1, 3, 5, 7), (6, 7), (3,)])
def test_pictures_tied_to_the_rest_by_few_points_are_named(strangers: tuple[int, ...]):
    theirs = np.arange(POINTS) < POINTS // 2
    seen = shown(0.8)
    for i in range(PICTURES):
        seen[i] &= theirs if i in strangers else ~theirs
    seen[:, :12] = True  # what the two have in common
    assert disjoint_views(a_row(seen)) == list(strangers)


def test_pictures_that_look_elsewhere_may_share_nothing():
    seen = shown(0.8)
    seen[5:, POINTS // 2 :] = False
    seen[:5, : POINTS // 2] = False
    assert disjoint_views(a_row(seen, turned=(5, 6, 7))) == []


def test_a_blurred_picture_shows_little_of_all_but_contradicts_nothing():
    seen = shown(0.8)
    seen[3] = shown(0.04)[3]
    assert 20 < seen[3].sum() < 50
    assert disjoint_views(a_row(seen)) == []


def test_pictures_without_points_say_nothing():
    assert disjoint_views(a_row(np.zeros((PICTURES, POINTS), bool))) == []
