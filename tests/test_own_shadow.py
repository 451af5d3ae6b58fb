# SPDX-License-Identifier: Apache-2.0
"""A robot's own shadow stands still in what looks down, and has the strongest edges there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from pilotage import Camera, OdometryConfig, Status, StereoOdometry, StereoRig, Transform
from pilotage.config import DOWNWARD

WIDTH, HEIGHT, FOCAL_PX, HEIGHT_M, BASE_M = 240, 180, 160.0, 0.5, 0.058
PIXELS = np.mgrid[:HEIGHT, :WIDTH].astype(float)


def shadow_at(x_px: Any, y_px: Any) -> Any:
    """Return how much light reaches the ground: a body with a mast stands in the sun."""
    body = (x_px > 40) & (x_px < 130) & (y_px > 90)
    mast = (np.abs(x_px - 85 - 0.3 * (90 - y_px)) < 6) & (y_px <= 90)
    return gaussian_filter(np.where(body | mast, 0.45, 1.0), 0.6)


def make_pictures(moved_px: list[float], contrast: float, grain_px: float) -> list[Any]:
    """Return pairs over rough ground that moves below the camera, while the shadow does not."""
    random = np.random.default_rng(5)
    ground = gaussian_filter(random.normal(size=(300, 1000)), grain_px)
    ground *= contrast / ground.std()
    disparity_px = FOCAL_PX * BASE_M / HEIGHT_M
    y_px, x_px = PIXELS

    def picture(moved: float, shift: float) -> Any:
        seen = map_coordinates(ground, [y_px + 60, x_px + shift + moved + 50], order=1)
        light = (110 + seen) * shadow_at(x_px + shift, y_px) + random.normal(0, 1, x_px.shape)
        return np.clip(light, 0, 255).astype(np.uint8)

    return [(picture(moved, 0), picture(moved, disparity_px)) for moved in moved_px]


@pytest.mark.parametrize(("contrast", "grain_px"), [(6, 1), (15, 1), (6, 2)])
def test_a_shadow_that_stands_still_loses_no_picture(contrast: float, grain_px: float) -> None:
    moved_px = [20.0 * step for step in np.cumsum(np.minimum(1, np.arange(24) / 4))]
    camera = Camera(
        width_px=WIDTH, height_px=HEIGHT, fx_px=FOCAL_PX, fy_px=FOCAL_PX, cx_px=119.5, cy_px=89.5
    )
    rig = StereoRig(
        left=camera, right=camera, right_from_left=Transform(translation_m=(-BASE_M, 0, 0))
    )
    odometry = StereoOdometry(rig=rig, config=OdometryConfig.from_dict(dict(DOWNWARD)))
    pairs = make_pictures(moved_px, contrast, grain_px)
    results = [odometry.track(*pair, i * 200_000_000) for i, pair in enumerate(pairs)]
    assert [result.status for result in results] == [Status.tracking] * len(results)
    found_px = [result.world_from_left.translation_m[0] * FOCAL_PX / HEIGHT_M for result in results]
    np.testing.assert_allclose(found_px, moved_px, atol=2)
