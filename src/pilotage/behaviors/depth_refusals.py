# SPDX-License-Identifier: Apache-2.0
"""Why two pictures tell no depth, and what helps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pilotage import Camera, PictureFate

if TYPE_CHECKING:
    from pilotage.recordings.frames import Grey

Array = NDArray[np.float64]
REFUSALS: Mapping[PictureFate, tuple[str, str]] = {
    PictureFate.few_features: (
        "the pictures show hardly any detail",
        "look at something with texture, with more light and less motion",
    ),
    PictureFate.no_matches: (
        "the pictures show nothing in common, or only what repeats itself",
        "take both of the same things, from places nearer to each other",
    ),
    PictureFate.no_parallax: (
        "both pictures were taken from one place: the camera turned or stood",
        "move the camera itself, up, down or sideways, a tenth of what it looks at or more",
    ),
    PictureFate.not_connected: (
        "too little of what both pictures show fits one motion of the camera",
        "let nothing move between the two, and check the calibration",
    ),
}
CELL_PX = 16
LEAST_CONTRAST = 8.0  # grey values in a cell, smoothed: less is noise
LEAST_DETAIL = 0.02  # of a picture's cells
TURN_WITHIN_PX = 2.5
TURN_SHARE = 0.6  # of the matches that a turn must explain
FEWEST_MATCHES = 20
TURN_ROUNDS = 15


def cause_of(fate: PictureFate, greys: list[Grey], camera: Camera) -> PictureFate:
    """Return what is behind `fate`: noise of a blank wall is no detail, a turn no motion."""
    if fate is PictureFate.few_features or any(not _has_detail(grey) for grey in greys):
        return PictureFate.few_features
    if fate is PictureFate.not_connected and _is_turn(greys, camera):
        return PictureFate.no_parallax
    return fate


def _has_detail(grey: Grey) -> bool:
    smooth = cv2.GaussianBlur(grey, (0, 0), 2).astype(np.float32)
    height, width = (side // CELL_PX * CELL_PX for side in smooth.shape)
    if not height or not width:
        return False
    cells = smooth[:height, :width].reshape(height // CELL_PX, CELL_PX, width // CELL_PX, CELL_PX)
    return bool((np.ptp(cells, axis=(1, 3)) > LEAST_CONTRAST).mean() > LEAST_DETAIL)


def _is_turn(greys: list[Grey], camera: Camera) -> bool:
    """Tell whether one rotation explains most of what is found again."""
    from pilotage import _core

    shown: list[dict[str, Any]] = [_core.describe_interest_points(image=grey) for grey in greys]
    pairs = _core.match_all(a=shown[0]["descriptors"], b=shown[1]["descriptors"])["pairs"]
    if len(pairs) < FEWEST_MATCHES:
        return False
    first, second = (
        camera.unproject(np.ascontiguousarray(shown[side]["points_px"][pairs[:, side]], np.float64))
        for side in range(2)
    )
    known = np.isfinite(first).all(axis=1) & np.isfinite(second).all(axis=1)
    first, second = first[known], second[known]
    weight, away_px = np.ones(len(first)), np.zeros(len(first))
    for _ in range(TURN_ROUNDS):
        turn = _rotation(first, second, weight)
        away_px = np.linalg.norm(first @ turn.T - second, axis=1) * camera.fx_px
        weight = 1 / (1 + (away_px / max(float(np.median(away_px)), 1)) ** 2) ** 2
    return bool((away_px < TURN_WITHIN_PX).mean() > TURN_SHARE)


def _rotation(first: Array, second: Array, weight: Array) -> Array:
    """Return the rotation that takes rays (N, 3) to others best."""
    u, _, v = np.linalg.svd(second.T @ (first * weight[:, None]))
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))])
    return np.asarray(u @ mirror @ v)
