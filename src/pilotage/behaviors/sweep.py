# SPDX-License-Identifier: Apache-2.0
"""Pictures of one place in several directions: what each shows, and what two of them share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pilotage import Camera, Transform, _core

if TYPE_CHECKING:
    from pilotage.calibration.nao_head import HeadAngles
    from pilotage.recordings.frames import Grey

Array = NDArray[np.float64]

NEAREST_M = 0.3  # nothing nearer is looked for
ASIDE_PX = 12.0  # by which a rotation told by encoders may be wrong
FURTHEST_APART_RAD = math.radians(60)  # optical axes of pictures that share anything
# Patches of 13x13 pixels, the largest there are: a match is good to a tenth of a pixel.
HALF_WINDOW_PX = 6
MOST_SHIFT_PX = 3.0
LEAST_CORRELATION = 0.8
FINEST_PX = 0.2  # no surface looks the same from another angle to less (measured)


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """One picture of a sweep, (height, width) uint8, by a camera with its lens.

    `head` and `torso_from_camera` are what the robot told of itself, None where nobody did. `stop`
    is the frame of the torso as it was first: a robot that crouches brings it elsewhere.
    """

    name: str
    grey: Grey
    lens: Camera
    camera: str = ""
    head: HeadAngles | None = None
    torso_from_camera: Transform | None = None
    stop_from_torso: Transform = field(default_factory=Transform)

    @property
    def stop_from_camera(self) -> Transform | None:
        """Return where the camera was by the robot's account, None where it gave none."""
        told = self.torso_from_camera
        return None if told is None else self.stop_from_torso @ told


@dataclass(frozen=True, kw_only=True, eq=False)
class Features:
    """Corners of one picture: `pixels` (N, 2), unit `rays` (N, 3) in its camera, descriptors."""

    pixels: Array
    rays: Array
    descriptors: NDArray[np.uint8]


@dataclass(frozen=True, kw_only=True, eq=False)
class Shared:
    """What pictures `a` and `b` both show: `pixels_a`, `pixels_b` (N, 2).

    `rows_a` (N,) are the rows among the features of a; places in b are found again by patches, so
    they are not those of b's features, whose rows are `rows_b`. `sigma_px` (N,) is of the latter.
    """

    a: int
    b: int
    pixels_a: Array
    pixels_b: Array
    rows_a: NDArray[np.intp]
    rows_b: NDArray[np.intp]
    sigma_px: Array
    quality: NDArray[np.float32]


def find_features(view: View) -> Features:
    """Return the corners of a picture, those left out where the lens model has no inverse."""
    found = _core.describe_interest_points(image=view.grey)
    pixels = np.ascontiguousarray(found["points_px"], np.float64)
    rays = view.lens.unproject(pixels)
    known = np.isfinite(rays).all(axis=1)
    return Features(pixels=pixels[known], rays=rays[known], descriptors=found["descriptors"][known])


def find_shared(views: Sequence[View], features: Sequence[Features]) -> list[Shared]:
    """Return the matches of every two pictures that may show the same.

    Where the robot told its head's angles only neighbours are compared, each feature with those
    near the place where a turn would put it; else all with all.
    """
    found = []
    for a, b in combinations(range(len(views)), 2):
        pairs, ratio = _candidates(views[a], views[b], features[a], features[b])
        if len(pairs):
            found.append(_refined(views, features, (a, b), pairs, ratio))
    return found


def _candidates(
    a: View, b: View, in_a: Features, in_b: Features
) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    stop_from_a, stop_from_b = a.stop_from_camera, b.stop_from_camera
    if stop_from_a is None or stop_from_b is None:
        matched = _core.match_all(a=in_a.descriptors, b=in_b.descriptors)
        return matched["pairs"], matched["ratio"]
    b_from_a = stop_from_b.inverse() @ stop_from_a
    turn = b_from_a.matrix()[:3, :3]
    ahead = in_a.rays @ turn.T
    predicted = b.lens.project(ahead)
    moved_m = float(np.linalg.norm(b_from_a.translation_m))
    radius_px = ASIDE_PX + b.lens.fx_px * moved_m / NEAREST_M
    inside = np.isfinite(predicted).all(axis=1) & (predicted > -radius_px).all(axis=1)
    inside &= (predicted < np.array([b.lens.width_px, b.lens.height_px]) + radius_px).all(axis=1)
    if turn[2, 2] < math.cos(FURTHEST_APART_RAD) or not inside.any():
        return np.empty((0, 2), np.intp), np.empty(0, np.float32)
    rows = np.flatnonzero(inside)
    matched = _core.match_in_windows(
        predicted_px=predicted[rows].astype(np.float32),
        radius_px=np.array([radius_px], np.float32),
        a=in_a.descriptors[rows],
        b_px=in_b.pixels.astype(np.float32),
        b=in_b.descriptors,
    )
    pairs = matched["pairs"].astype(np.intp)
    pairs[:, 0] = rows[pairs[:, 0]]
    return pairs, matched["ratio"]


def _refined(
    views: Sequence[View],
    features: Sequence[Features],
    numbers: tuple[int, int],
    pairs: NDArray[np.intp],
    ratio: NDArray[np.float32],
) -> Shared:
    a, b = numbers
    options = _core.SubpixelOptions()
    options.half_width_px = options.half_height_px = HALF_WINDOW_PX
    options.max_shift_px = MOST_SHIFT_PX
    pixels_a = features[a].pixels[pairs[:, 0]]
    better = _core.refine_matches(
        a=views[a].grey, points_in_a_px=pixels_a.astype(np.float32),
        b=views[b].grey, guesses_in_b_px=features[b].pixels[pairs[:, 1]].astype(np.float32),
        options=options,
    )  # fmt: skip
    kept = better["ok"].astype(bool) & (better["correlation"] > LEAST_CORRELATION)
    sigma_px = np.maximum(better["sigma_px"].max(axis=1), FINEST_PX)
    return Shared(
        a=a, b=b,
        pixels_a=pixels_a[kept],
        pixels_b=better["position_px"][kept].astype(np.float64),
        rows_a=pairs[kept, 0], rows_b=pairs[kept, 1],
        sigma_px=sigma_px[kept].astype(np.float64),
        quality=1 - ratio[kept],
    )  # fmt: skip
