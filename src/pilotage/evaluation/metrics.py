# SPDX-License-Identifier: Apache-2.0
"""Errors of a trajectory against truth. Pure functions; no input is changed.

Poses are `world_from_body`, (N, 4, 4), metres, NaN where there is none; estimate and truth speak
of the same body at the same N moments, in worlds of their own.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pilotage.evaluation.poses import (
    Array,
    Similarity,
    align,
    inverse,
    rotation_vectors,
    way_m,
)

Alignment = Literal["se3", "origin", "none"]

SEGMENT_LENGTHS_M = (10.0, 20.0, 30.0, 40.0)
SEGMENT_SHARES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
# 99 % quantile of chi-square with six degrees of freedom.
CHI_SQUARE_6_99 = 16.812
# Below this extent a path stands still: a scale or an error in percent says nothing.
STILL_M = 0.05


@dataclass(frozen=True)
class SegmentError:
    """Mean errors of all segments of one length."""

    length_m: float
    segments: int
    translation_percent: float
    rotation_deg_m: float


@dataclass(frozen=True)
class Consistency:
    """NEES, the squared error in units of the covariance: 6 on average when the latter is true."""

    poses: int
    mean_nees: float
    share_within_99_percent: float


@dataclass(frozen=True)
class Metrics:
    """All figures of one evaluation. NaN or None where the data cannot tell."""

    pairs: int
    compared: int
    lost: int
    truth_length_m: float
    alignment: Alignment
    ate_rmse_m: float
    ate_median_m: float
    ate_max_m: float
    ate_percent_of_length: float
    translation_percent: float
    rotation_deg_m: float
    segments: list[SegmentError]
    rpe_translation_rmse_m: float
    rpe_translation_median_m: float
    rpe_rotation_rmse_deg: float
    end_error_m: float
    end_error_percent: float
    origin_error_max_m: float
    scale: float
    consistency: Consistency | None

    def to_dict(self) -> dict[str, Any]:
        """Return plain values by name, for JSON."""
        return asdict(self)


def evaluate_trajectory(
    *,
    estimate: Array,
    truth: Array,
    covariances: Array | None = None,
    alignment: Alignment = "se3",
    lengths_m: tuple[float, ...] | None = None,
) -> Metrics:
    """Return all metrics of (N, 4, 4) `estimate` against `truth`, both NaN where unknown.

    `covariances` (N, 6, 6) are as in `nees`. ValueError where fewer than two moments have both.
    """
    known = has_pose(estimate) & has_pose(truth)
    if known.sum() < 2:
        raise ValueError("fewer than two pairs have both a pose and truth")
    distances = distance_along(truth)
    length_m = float(np.nanmax(distances))
    errors = position_errors(estimate=estimate, truth=truth, alignment=alignment)[known]
    from_origin = position_errors(estimate=estimate, truth=truth, alignment="origin")[known]
    segments, every = segment_errors(estimate, truth, distances, lengths_m)
    steps = step_errors(estimate, truth)
    ate = rmse(errors)
    moves = length_m > STILL_M
    return Metrics(
        pairs=len(estimate),
        compared=int(known.sum()),
        lost=int((~has_pose(estimate)).sum()),
        truth_length_m=length_m,
        alignment=alignment,
        ate_rmse_m=ate,
        ate_median_m=float(np.median(errors)),
        ate_max_m=float(errors.max()),
        ate_percent_of_length=100 * ate / length_m if moves else float("nan"),
        translation_percent=mean(every[:, 0]),
        rotation_deg_m=mean(every[:, 1]),
        segments=segments,
        rpe_translation_rmse_m=rmse(steps[:, 0]),
        rpe_translation_median_m=float(np.median(steps[:, 0])) if len(steps) else float("nan"),
        rpe_rotation_rmse_deg=rmse(np.degrees(steps[:, 1])),
        end_error_m=float(from_origin[-1]),
        end_error_percent=100 * float(from_origin[-1]) / length_m if moves else float("nan"),
        origin_error_max_m=float(from_origin.max()),
        scale=scale_of(estimate[known], truth[known]) if moves else float("nan"),
        consistency=consistency(estimate, truth, covariances),
    )


def has_pose(poses: Array) -> NDArray[np.bool_]:
    """Tell, (N,), where there is a pose."""
    return np.asarray(np.isfinite(poses).all(axis=(1, 2)), dtype=np.bool_)


def distance_along(truth: Array) -> Array:
    """Return the (N,) way travelled since the first known pose; NaN where unknown."""
    return way_m(np.where(has_pose(truth)[:, None], truth[:, :3, 3], np.nan))


def alignment_of(*, estimate: Array, truth: Array, alignment: Alignment) -> Similarity:
    """Return `truth_world_from_estimate_world` of (N, 4, 4) poses that are all known."""
    if alignment == "se3":
        return align(points_in_a=estimate[:, :3, 3], points_in_b=truth[:, :3, 3])
    if alignment == "origin":
        first = truth[0] @ inverse(estimate[0])
        return Similarity(first[:3, :3], first[:3, 3])
    return Similarity(np.eye(3), np.zeros(3))


def position_errors(*, estimate: Array, truth: Array, alignment: Alignment) -> Array:
    """Return (N,) distances between aligned estimate and truth, metres; NaN where unknown."""
    known = has_pose(estimate) & has_pose(truth)
    fit = alignment_of(estimate=estimate[known], truth=truth[known], alignment=alignment)
    errors = np.full(len(estimate), np.nan)
    moved = fit.apply(estimate[known])
    errors[known] = np.linalg.norm(moved[:, :3, 3] - truth[known, :3, 3], axis=1)
    return errors


def scale_of(estimate: Array, truth: Array) -> float:
    """Return how much too large the estimate is: 1.01 means one percent. From a Sim(3) fit."""
    fit = align(points_in_a=truth[:, :3, 3], points_in_b=estimate[:, :3, 3], with_scale=True)
    return fit.scale


def segment_lengths(path_length_m: float) -> tuple[float, ...]:
    """Return 10, 20, 30, 40 m where the path is that long; 10 to 80 % of it otherwise."""
    if path_length_m >= SEGMENT_LENGTHS_M[-1]:
        return SEGMENT_LENGTHS_M
    return tuple(share * path_length_m for share in SEGMENT_SHARES)


def segment_errors(
    estimate: Array, truth: Array, distances: Array, lengths_m: tuple[float, ...] | None = None
) -> tuple[list[SegmentError], Array]:
    """Return the errors per length and of (K, 2) all segments (%, degrees per metre).

    As the KITTI benchmark has it (Geiger et al. 2012): from every start, to the first pair that is
    the length further on by the truth; errors are divided by the nominal length. Segments that
    begin or end at a lost pair do not count, those that span one do.
    """
    whole = float(np.nanmax(distances))
    if whole < STILL_M:
        return [], np.zeros((0, 2))
    known = np.flatnonzero(has_pose(truth))
    solved = has_pose(estimate)
    along = distances[known]
    table, every = [], [np.zeros((0, 2))]
    for length_m in lengths_m or segment_lengths(whole):
        # A hair less than the length: sums of steps are not exact.
        end_at = np.searchsorted(along, along + length_m - 1e-9 * whole)
        reaches = end_at < len(along)
        start, end = known[reaches], known[end_at[reaches]]
        counts = solved[start] & solved[end]
        start, end = start[counts], end[counts]
        errors = relative_errors(estimate, truth, start, end)
        scaled = np.column_stack([100 * errors[:, 0], np.degrees(errors[:, 1])]) / length_m
        if len(scaled):
            table.append(
                SegmentError(length_m, len(scaled), mean(scaled[:, 0]), mean(scaled[:, 1]))
            )
        every.append(scaled)
    return table, np.concatenate(every)


def relative_errors(
    estimate: Array, truth: Array, start: NDArray[np.int64], end: NDArray[np.int64]
) -> Array:
    """Return (K, 2) errors, metres and radians, of the motions from `start` to `end`."""
    estimated = inverse(estimate[start]) @ estimate[end]
    true = inverse(truth[start]) @ truth[end]
    error = inverse(true) @ estimated
    angles = np.linalg.norm(rotation_vectors(error[:, :3, :3]), axis=1)
    return np.column_stack([np.linalg.norm(error[:, :3, 3], axis=1), angles])


def step_errors(estimate: Array, truth: Array) -> Array:
    """Return (K, 2) errors, metres and radians, between neighbours that both are known."""
    known = has_pose(estimate) & has_pose(truth)
    start = np.flatnonzero(known[:-1] & known[1:])
    return relative_errors(estimate, truth, start, start + 1)


def nees(estimate: Array, truth: Array, covariances: Array) -> Array:
    """Return (N,) squared errors in units of the covariance; NaN where unknown.

    Both trajectories are laid onto each other at the first known pose, where a trajectory's own
    covariance is zero by choice of its world; so that pose, and any without covariance, is NaN.
    Errors and covariances (N, 6, 6) are x y z along the axes of the estimate's world, metres, and
    rotation about them, radians: true = (exp(rotation) * R, position + p).
    """
    known = np.flatnonzero(has_pose(estimate) & has_pose(truth))
    result = np.full(len(estimate), np.nan)
    if len(known) == 0:
        return result
    laid = alignment_of(estimate=truth[known], truth=estimate[known], alignment="origin")
    true, estimated = laid.apply(truth[known]), estimate[known]
    turns = rotation_vectors(true[:, :3, :3] @ np.swapaxes(estimated[:, :3, :3], 1, 2))
    errors = np.hstack([true[:, :3, 3] - estimated[:, :3, 3], turns])
    for index, error in zip(known[1:], errors[1:], strict=True):
        covariance = covariances[index]
        if np.isfinite(covariance).all() and np.linalg.eigvalsh(covariance)[0] > 0:
            result[index] = error @ np.linalg.solve(covariance, error)
    return result


def consistency(estimate: Array, truth: Array, covariances: Array | None) -> Consistency | None:
    """Return how the covariances hold against truth; None where there are none."""
    if covariances is None:
        return None
    values = nees(estimate, truth, covariances)
    values = values[np.isfinite(values)]
    if len(values) == 0:
        return None
    return Consistency(len(values), mean(values), float((values <= CHI_SQUARE_6_99).mean()))


def rmse(values: Array) -> float:
    """Return the root of the mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def mean(values: Array) -> float:
    """Return the mean; NaN of nothing."""
    return float(values.mean()) if len(values) else float("nan")
