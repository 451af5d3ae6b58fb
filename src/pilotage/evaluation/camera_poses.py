# SPDX-License-Identifier: Apache-2.0
"""Errors of the poses of a reconstruction, whose world and scale are its own, against truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pilotage.evaluation.metrics import STILL_M, has_pose, rmse
from pilotage.evaluation.poses import Array, Similarity, align, rotation_vectors, way_m

# With fewer, a similarity goes through all centres and no error is left.
FEWEST = 3


@dataclass(frozen=True)
class PoseErrors:
    """After a similarity has laid the centres onto the truth. Metres where the truth is metric."""

    compared: int
    ate_rmse_m: float
    ate_median_m: float
    ate_max_m: float
    ate_percent_of_length: float
    rotation_median_deg: float
    rotation_max_deg: float
    scale: float
    """What the reconstruction's lengths have to be multiplied by."""


def pose_errors(*, estimate: Array, truth: Array) -> PoseErrors | None:
    """Return the errors of (N, 4, 4) `world_from_camera` poses; None where fewer than three meet.

    Both are NaN where there is no pose, and in worlds of their own.
    """
    known = has_pose(estimate) & has_pose(truth)
    if known.sum() < FEWEST:
        return None
    estimated, true = estimate[known], truth[known]
    fit = align(points_in_a=estimated[:, :3, 3], points_in_b=true[:, :3, 3], with_scale=True)
    errors = np.linalg.norm(fit.apply(estimated)[:, :3, 3] - true[:, :3, 3], axis=1)
    turns_deg = np.degrees(rotation_errors(estimate=estimated, truth=true))
    length_m = float(np.nanmax(way_m(truth[:, :3, 3])))
    ate = rmse(errors)
    return PoseErrors(
        compared=int(known.sum()),
        ate_rmse_m=ate,
        ate_median_m=float(np.median(errors)),
        ate_max_m=float(errors.max()),
        ate_percent_of_length=100 * ate / length_m if length_m > STILL_M else float("nan"),
        rotation_median_deg=float(np.median(turns_deg)),
        rotation_max_deg=float(turns_deg.max()),
        scale=fit.scale,
    )


def rotation_errors(*, estimate: Array, truth: Array) -> Array:
    """Return (N,) angles, radians, that are left once one turn has laid all onto the truth's.

    The turn is the mean of those wanted, not that of the centres: a straight row of cameras leaves
    the turn about the row open.
    """
    wanted = truth[:, :3, :3] @ np.swapaxes(estimate[:, :3, :3], 1, 2)
    mean = Rotation.from_matrix(wanted).mean().as_matrix()
    turned = Similarity(mean, np.zeros(3)).apply(estimate)[:, :3, :3]
    left = np.swapaxes(truth[:, :3, :3], 1, 2) @ turned
    return np.asarray(np.linalg.norm(rotation_vectors(left), axis=1))
