# SPDX-License-Identifier: Apache-2.0
"""A run as its figures show it: forward, left and up from where it began."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pilotage.evaluation.metrics import alignment_of, has_pose
from pilotage.evaluation.poses import Array
from pilotage.evaluation.truth import poses_of
from pilotage.pose_files import PoseRecord

if TYPE_CHECKING:
    from pilotage.evaluation.evaluate import Comparison


@dataclass(frozen=True)
class Course:
    """A run as drawn: each array has an entry per pair, NaN where there is none.

    `position_m` (N, 3) is forward, left, up as seen by the body at its first pose.
    """

    time_s: Array
    position_m: Array
    deviation_m: Array
    is_lost: NDArray[np.bool_]
    is_degraded: NDArray[np.bool_]
    records: Sequence[PoseRecord]
    axes: Array

    def measure(self, name: str) -> Array:
        """Return a number of each record, NaN where the pair was lost."""
        values = np.array([float(getattr(record, name)) for record in self.records])
        return np.where(self.is_lost, np.nan, values)


def course_of(records: Sequence[PoseRecord], body: str) -> Course:
    """Return what the figures need of a run; `body` is left (a camera) or robot."""
    poses = poses_of(records)
    known = has_pose(poses)
    axes = _view_axes(poses[known][0] if known.any() else np.eye(4), body)
    times_ns = np.array([record.timestamp_ns for record in records], dtype=np.int64)
    deviations = np.full(len(records), np.nan)
    for at, record in enumerate(records):
        if record.covariance is not None:
            deviations[at] = np.sqrt(max(float(np.trace(record.covariance[:3, :3])), 0.0))
    origin = poses[known][0][:3, 3] if known.any() else np.zeros(3)
    return Course(
        time_s=(times_ns - times_ns[0]) * 1e-9 if len(records) else np.zeros(0),
        position_m=(poses[:, :3, 3] - origin) @ axes.T,
        deviation_m=deviations,
        is_lost=~known,
        is_degraded=np.array([record.status == "degraded" for record in records], dtype=bool),
        records=records,
        axes=axes,
    )


def _view_axes(world_from_body: Array, body: str) -> Array:
    """Return (3, 3): rows are forward, left and up of the body in the world."""
    columns = world_from_body[:3, :3].T
    if body == "robot":
        return np.array(columns)
    return np.array([columns[2], -columns[0], -columns[1]])


def truth_in_view(course: Course, comparison: Comparison) -> Array:
    """Return the (N, 3) truth laid onto the estimate, in the axes of `course.position_m`."""
    estimate = poses_of(course.records)
    both = has_pose(estimate) & has_pose(comparison.truth)
    fit = alignment_of(
        estimate=comparison.truth[both],
        truth=estimate[both],
        alignment=comparison.metrics.alignment,
    )
    origin = estimate[has_pose(estimate)][0][:3, 3]
    laid = np.full((len(estimate), 3), np.nan)
    known = has_pose(comparison.truth)
    laid[known] = (fit.apply(comparison.truth[known])[:, :3, 3] - origin) @ course.axes.T
    return laid
