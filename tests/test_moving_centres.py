# SPDX-License-Identifier: Apache-2.0
"""A head's sweep with cameras that move: angles, points and distances against rendered truth."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest

from pilotage import Transform
from pilotage.behaviors.mosaic import directions_by_homographies, join_by_homographies, link_views
from pilotage.behaviors.moving_centres import Refined, refine_sweep
from pilotage.behaviors.sweep import Features, Shared, View, find_features, find_shared
from pilotage.behaviors.virtual_camera import distances_of, see_features
from pilotage.simulation.nao import TORSO_M

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

from sweep_pictures import SweepingNao, TrueView, sweep_goals, things_at, true_points


@pytest.fixture(scope="module")
def sweep() -> list[TrueView]:
    nao = SweepingNao(things_at([1.0], 1), width_px=320, seed=2)
    return nao.look_at(sweep_goals(from_left=True))


@pytest.fixture(scope="module")
def shared(sweep: list[TrueView]) -> tuple[list[Features], list[Shared]]:
    views = [seen.view for seen in sweep]
    features = [find_features(view) for view in views]
    return features, find_shared(views, features)


@pytest.fixture(scope="module")
def refined(sweep: list[TrueView], shared: tuple[list[Features], list[Shared]]) -> Refined:
    return refine_sweep([seen.view for seen in sweep], shared[1])


def test_angles_of_the_head_are_refined(sweep: list[TrueView], refined: Refined):
    def off_rad(poses: list[Transform]) -> list[float]:
        middle = next(i for i, s in enumerate(sweep) if s.view.name == "top +0.0 +0.0")
        true = sweep[middle].world_from_camera.inverse()
        return [
            float(np.linalg.norm((poses[middle].inverse() @ pose @ (
                true @ seen.world_from_camera).inverse()).log()[3:]))
            for seen, pose in zip(sweep, poses, strict=True)
        ]  # fmt: skip

    told = [seen.view.torso_from_camera for seen in sweep]
    assert max(off_rad(told)) > 2e-3
    assert max(off_rad(refined.stop_from_camera)) < 8e-4
    assert refined.reason == ""
    assert refined.rms_px < 0.3


def test_points_of_the_sweep_are_where_they_are(
    sweep: list[TrueView], shared: tuple[list[Features], list[Shared]], refined: Refined
):
    errors = []
    for point, number, row in zip(refined.points_in_stop, refined.shared, refined.row, strict=True):
        found = shared[1][number]
        x, y = np.rint(found.pixels_a[row]).astype(int)
        depth_m = sweep[found.a].depth_m[y, x]
        if depth_m > 0:
            told_m = (refined.stop_from_camera[found.a].inverse() @ point)[2]
            errors.append(1 / told_m - 1 / depth_m)
    assert len(errors) > 150
    # A pixel of 1/272 rad over 3.4 cm is 0.11 / m.
    assert np.median(np.abs(errors)) < 0.03


def test_a_crouch_tells_distances_of_what_one_direction_shows():
    nao = SweepingNao(things_at([1.0, 2.0], 1), width_px=320, seed=2)
    seen = nao.look_at(sweep_goals(from_left=True))
    nao.crouch()
    lower = nao.look_at(sweep_goals(from_left=False))
    together = [found.view for found in (*seen, *lower)]
    features = [find_features(view) for view in together]
    matches = find_shared(together, features)
    alone = [found for found in matches if max(found.a, found.b) < len(seen)]
    shares = []
    for views, used in ((together[: len(seen)], alone), (together, matches)):
        refined = refine_sweep(views, used)
        distances = distances_of(refined, 2, -TORSO_M["stand"])
        side = see_features(features[: len(seen)], used, refined, distances)[0]
        shares.append(side.is_measured.mean())
        true = seen[2].world_from_camera.inverse() @ true_points(seen[0], features[0])[0]
        known = side.is_measured & true_points(seen[0], features[0])[1]
        ratio = side.distance_m[known] / np.linalg.norm(true[known], axis=1)
        assert np.median(np.abs(ratio - 1)) < 0.05
    assert shares[0] < 0.35
    assert shares[1] > 0.45


def test_homographies_fail_where_things_are_near(
    sweep: list[TrueView], shared: tuple[list[Features], list[Shared]]
):
    views = [seen.view for seen in sweep]
    features, matches = shared
    joined = join_by_homographies(views, link_views(views, matches))
    assert views[joined.middle].name == "top +0.0 +0.0"
    side = next(i for i, view in enumerate(views) if view.name == "top +33.5 +0.0")
    directions = directions_by_homographies(joined, features)[side]
    true = sweep[joined.middle].world_from_camera.inverse() @ sweep[side].world_from_camera
    turned = features[side].rays @ true.matrix()[:3, :3].T
    # Things 1 m away are seen 2 degrees off: a homography cannot know by how much each is.
    assert np.median(np.linalg.norm(np.cross(directions, turned), axis=1)) > math.radians(0.5)


def test_without_anything_shared_angles_stay_as_told(sweep: list[TrueView]):
    views = [seen.view for seen in sweep]
    found = refine_sweep(views, [])
    assert "fewer than 12 points" in found.reason
    assert len(found.points_in_stop) == 0
    for view, pose in zip(views, found.stop_from_camera, strict=True):
        np.testing.assert_array_equal(pose.matrix(), view.torso_from_camera.matrix())


def test_a_view_without_a_head_has_no_moving_centres(sweep: list[TrueView]):
    seen = sweep[0].view
    blind = View(name="a", grey=seen.grey, lens=seen.lens)
    with pytest.raises(ValueError, match="a: the robot told no head angles"):
        refine_sweep([blind, blind], [])
