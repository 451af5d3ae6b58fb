# SPDX-License-Identifier: Apache-2.0
"""Depth from two pictures of one camera, taken from two places a known distance apart."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pilotage import Camera, PictureFate, Transform
from pilotage.behaviors.depth_refusals import REFUSALS, cause_of
from pilotage.behaviors.reconstruct import check_size, read_greys
from pilotage.behaviors.stretch import find_stretches
from pilotage.errors import InputError

if TYPE_CHECKING:
    from pilotage import Reconstruction, ReconstructionConfig
    from pilotage._core import TwoViews
    from pilotage.recordings.frames import Grey

Array = NDArray[np.float64]

# What two pictures need otherwise than a walk: points that only two show, also far ones, and
# corners alone, for blobs look a little different from elsewhere, all in the same way.
TWO_PICTURES: Mapping[str, Any] = {
    "min_track_length": 2, "min_angle_deg": 0.25, "uses_dog": False,
}  # fmt: skip
BASELINE_M = (0.001, 1000.0)
FEWEST = 20  # points; with less nothing shows that the motion is the true one
SCARCE = 60  # points; with less the structure has holes
LEAST_SHARE = 0.5  # of what both pictures show must fit one motion
WORST_DIRECTION_RAD = 0.3  # standard error of the motion's direction
WORST_MEDIAN = 0.3  # relative error of the depths: beyond, the camera hardly moved
ALIKE = 0.15  # relative difference of depths that confirm each other
SAME_PX = 3.0
CONFIRMING = 8  # nearest points, of which one must confirm a depth
WORST_ERROR = 0.5  # of a depth, in parts of it: beyond, a point says next to nothing
OUTLIER_SIGMA = 4.0
# Matches are found again by patches of 13x13 pixels, the largest there are.
HALF_WINDOW_PX = 6
MOST_SHIFT_PX = 3.0
LEAST_CORRELATION = 0.7
FINEST_PX = 0.03  # no surface looks the same from elsewhere to less


@dataclass(frozen=True, kw_only=True, eq=False)
class Depth:
    """What two pictures tell of distances. Without `second_from_first` they tell nothing: `reason`.

    `points_m` (N, 3) are in the first camera (x right, y down, z forward), `pixels` (N, 2) in the
    first picture. `distance_m` (N,) is along the ray, `depth_m` along z, each with its standard
    error. `warning` says where a result is thin.
    """

    second_from_first: Transform | None
    points_m: Array
    pixels: Array
    distance_m: Array
    depth_m: Array
    distance_sigma_m: Array
    depth_sigma_m: Array
    camera: Camera
    sigma_px: float = math.nan
    reason: str = ""
    remedy: str = ""
    warning: str = ""

    @property
    def is_good(self) -> bool:
        """Tell whether there is a structure."""
        return self.second_from_first is not None


@dataclass(frozen=True, kw_only=True, eq=False)
class Rays:
    """Matched rays (N, 3) with z = 1, and the standard errors (N, 2) of x and y of the second."""

    first: Array
    second: Array
    sigma: Array


def measure_depth(  # noqa: PLR0913, all by name
    first: Path | Grey,
    second: Path | Grey,
    *,
    camera: Camera,
    baseline_m: float,
    baseline_sigma_m: float = 0.0,
    config: ReconstructionConfig | None = None,
) -> Depth:
    """Return distances of what both pictures show, the camera's two places `baseline_m` apart.

    Pictures are files or (height, width) uint8 arrays of the camera's size; the first is the one
    that is measured in. InputError for pictures that cannot be read, of another size, and for a
    baseline out of range. What cannot be measured is said in `reason`.
    """
    from pilotage import _core

    check_baseline(baseline_m, baseline_sigma_m)
    config = config or two_picture_config()
    if int(str(config.min_track_length)) > 2:
        raise InputError(f"min_track_length {config.min_track_length}: must be 2 for two pictures")
    greys = [_grey(picture, camera) for picture in (first, second)]
    found = _core.reconstruct(
        pictures=greys,
        cameras=[camera],
        camera_of_picture=[0, 0],
        is_ordered=True,
        config=config,
    )
    poses = [pose for pose in found.camera_from_world if pose is not None]
    if len(poses) < 2:
        return _refused(camera, cause_of(_worst(found.fates), greys))
    pixels, pixels_in_second = _matches(found)
    if len(pixels) < max(FEWEST, LEAST_SHARE * found.track_count):
        return _refused(camera, cause_of(_worst(found.fates_if_unposed), greys))
    pixels, rays = _refined(greys, camera, pixels, pixels_in_second)
    if len(pixels) < FEWEST:
        return _refused(camera, cause_of(_worst(found.fates_if_unposed), greys))
    views = _core.refine_two_views(
        rays_in_first=rays.first, rays_in_second=rays.second, sigma=rays.sigma,
        second_from_first=poses[1] @ poses[0].inverse(),
    )  # fmt: skip
    return _measured(camera, pixels, rays, views, baseline_m, baseline_sigma_m)


def two_picture_config() -> ReconstructionConfig:
    """Return the configuration that suits two pictures."""
    from pilotage import ReconstructionConfig

    return ReconstructionConfig.from_dict(dict(TWO_PICTURES))


def check_baseline(baseline_m: float, baseline_sigma_m: float) -> None:
    """Raise InputError unless a baseline and its standard error can be."""
    least, most = BASELINE_M
    if not least <= baseline_m <= most:
        raise InputError(f"baseline {baseline_m:g} m: must be from {least:g} to {most:g}")
    if not 0 <= baseline_sigma_m < baseline_m:
        raise InputError(
            f"standard error {baseline_sigma_m:g} m of the baseline: must be from 0 to less than"
            f" the baseline, {baseline_m:g}"
        )


def _measured(  # noqa: PLR0913, PLR0917, all that a depth is made of
    camera: Camera,
    pixels: Array,
    rays: Rays,
    views: TwoViews,
    baseline_m: float,
    baseline_sigma_m: float,
) -> Depth:
    depth = views.depths
    of_baseline = depth * baseline_sigma_m / baseline_m
    sigma = np.sqrt(
        views.depth_sigmas_of_pixels**2 + views.depth_sigmas_of_motion**2 + of_baseline**2
    )
    fits = np.isfinite(depth) & (depth > 0)
    fits &= np.abs(views.residuals) < OUTLIER_SIGMA
    is_near = fits & (sigma < WORST_ERROR * depth)
    is_near &= _is_confirmed(pixels, depth, sigma, is_near)
    direction_sigma = math.sqrt(max(np.linalg.eigvalsh(views.covariance[3:, 3:])))
    is_sure = is_near.any() and np.median((sigma / depth)[is_near]) < WORST_MEDIAN
    if (
        not is_sure
        or direction_sigma > WORST_DIRECTION_RAD
        or is_near.sum() < LEAST_SHARE * fits.sum()
    ):
        return _refused(camera, PictureFate.no_parallax)
    if is_near.sum() < FEWEST:
        return _refused(camera, PictureFate.not_connected)
    turned = views.second_from_first.matrix()
    turned[:3, 3] *= baseline_m
    depth_m, sigma_m = baseline_m * depth[is_near], baseline_m * sigma[is_near]
    ahead = rays.first[is_near]
    length = np.linalg.norm(ahead, axis=1)
    return Depth(
        second_from_first=Transform.from_matrix(turned),
        points_m=ahead * depth_m[:, None],
        pixels=pixels[is_near],
        distance_m=depth_m * length, depth_m=depth_m,
        distance_sigma_m=sigma_m * length, depth_sigma_m=sigma_m,
        camera=camera,
        sigma_px=views.scale * float(np.median(rays.sigma[is_near])) * camera.fx_px,
        warning=_warning(int(is_near.sum()), float(np.median(sigma_m / depth_m))),
    )  # fmt: skip


def _is_confirmed(
    pixels: Array, depth: Array, sigma: Array, is_near: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Tell of each point (N,) whether one of its neighbours has such a depth: wrong matches have
    any, and along the motion nothing else shows them."""
    rows = np.flatnonzero(is_near)
    confirmed = np.zeros(len(pixels), bool)
    at, value, error = pixels[rows], depth[rows], sigma[rows]
    away = np.maximum(*(np.abs(at[:, None, axis] - at[:, axis]) for axis in range(2)))
    away[away < SAME_PX] = np.inf  # two detections of one thing share their fault
    count = min(CONFIRMING, len(rows))
    others = np.argpartition(away, count - 1, axis=1)[:, :count] if count else away.astype(int)
    bound = np.maximum(ALIKE * value[:, None], 2 * np.hypot(error[:, None], error[others]))
    confirmed[rows] = (np.abs(value[others] - value[:, None]) < bound).any(axis=1)
    return confirmed


def _warning(count: int, relative_error: float) -> str:
    if count < SCARCE:
        return f"only {count} points: much of the picture has no depth; more light or detail helps"
    if relative_error > 0.1:
        return (
            f"depths are uncertain by {100 * relative_error:.0f} %: a longer baseline, or nearer"
            " things, would help"
        )
    return ""


def _refused(camera: Camera, fate: PictureFate) -> Depth:
    reason, remedy = REFUSALS[fate]
    none = np.empty(0)
    return Depth(
        second_from_first=None, points_m=np.empty((0, 3)), pixels=np.empty((0, 2)),
        distance_m=none, depth_m=none, distance_sigma_m=none, depth_sigma_m=none,
        camera=camera, reason=reason, remedy=remedy,
    )  # fmt: skip


def _worst(fates: Sequence[PictureFate]) -> PictureFate:
    """Return what keeps two pictures apart: one's lack of detail explains all else."""
    order = list(REFUSALS)
    return min((f for f in fates if f is not PictureFate.posed), key=order.index)


def _matches(found: Reconstruction) -> tuple[Array, Array]:
    """Return the pixels (N, 2) of points in both pictures."""
    picture, point = np.asarray(found.view_pictures), np.asarray(found.view_points)
    pixel = np.asarray(found.view_px, dtype=np.float64)
    place: list[Any] = []
    for number in range(2):
        rows = np.full(point.max(initial=-1) + 1, -1)
        rows[point[picture == number]] = np.flatnonzero(picture == number)
        place.append(rows)
    both = (place[0] >= 0) & (place[1] >= 0)
    return pixel[place[0][both]], pixel[place[1][both]]


def _refined(greys: list[Grey], camera: Camera, first: Array, second: Array) -> tuple[Array, Rays]:
    """Return pixels and rays of matches found again to a tenth of a pixel, with their errors."""
    from pilotage import _core

    options = _core.SubpixelOptions()
    options.half_width_px = options.half_height_px = HALF_WINDOW_PX
    options.max_shift_px = MOST_SHIFT_PX
    options.doubts_gradients = True
    options.max_iterations = 40
    better = _core.refine_matches(
        a=greys[0], points_in_a_px=first.astype(np.float32),
        b=greys[1], guesses_in_b_px=second.astype(np.float32), options=options,
        a_from_b=find_stretches(first, second),
    )  # fmt: skip
    is_same = better["ok"].astype(bool) & (better["correlation"] > LEAST_CORRELATION)
    pixels = np.ascontiguousarray(first[is_same])
    found_px = better["position_px"][is_same].astype(np.float64)
    sigma_px = np.maximum(better["sigma_px"][is_same].astype(np.float64), FINEST_PX)
    rays = Rays(
        first=_rays(camera, pixels),
        second=_rays(camera, found_px),
        sigma=sigma_px / (camera.fx_px, camera.fy_px),
    )
    return pixels, rays


def _rays(camera: Camera, pixels: Array) -> Array:
    rays = camera.unproject(np.ascontiguousarray(pixels))
    return np.asarray(rays / rays[:, 2:])


def _grey(picture: Path | Grey, camera: Camera) -> Grey:
    if isinstance(picture, Path):
        return read_greys([picture], camera)[0]
    if picture.ndim != 2 or picture.dtype != np.uint8:
        raise InputError("an array: a picture must be (height, width) of uint8")
    check_size("an array", picture, camera)
    return picture
