# SPDX-License-Identifier: Apache-2.0
"""A results folder against truth: the figures, written into the folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from pilotage.atomic_files import write_atomically
from pilotage.errors import InputError
from pilotage.evaluation.metrics import Alignment, Metrics, evaluate_trajectory, has_pose
from pilotage.evaluation.poses import Array, inverse
from pilotage.evaluation.truth import (
    Body,
    TruthPoses,
    find_body_from_left,
    load_truth,
    poses_of,
)
from pilotage.pose_files import PoseRecord, tum_line
from pilotage.results import (
    CALIBRATION,
    EVALUATION,
    TRUTH,
    Results,
    read_pair_records,
    read_results,
    write_json,
)


@dataclass(frozen=True)
class Comparison:
    """A run, the truth at its pairs in the run's own body (N, 4, 4), and the figures.

    `alone` holds the same of each stereo pair by itself, where several were joined; None for a pair
    that truth and poses do not tell of.
    """

    results: Results
    truth: Array
    metrics: Metrics
    alone: Mapping[str, Comparison | None] = field(default_factory=dict)


def evaluate_results(
    out: Path,
    *,
    truth_path: Path | None = None,
    truth_of: Body | None = None,
    alignment: Alignment = "se3",
    lengths_m: tuple[float, ...] | None = None,
) -> Comparison:
    """Compare the results in `out` with truth and write evaluation.json and truth_tum.txt there.

    Without `truth_path` the truth that came with the recording is taken. `truth_of` tells whose
    poses the truth holds where the file cannot. InputError where the two do not meet.
    """
    results = read_results(out)
    truth = _truth(results, truth_path, truth_of)
    at_pairs = truth.at(results.records)
    comparison = compare(results, at_pairs, alignment=alignment, lengths_m=lengths_m)
    alone = _alone(results, truth, alignment, lengths_m)
    comparison = replace(comparison, alone=alone)
    report: dict[str, Any] = {
        "truth": str(truth_path or out / TRUTH),
        "poses": "adjusted" if results.adjusted else "live",
        **comparison.metrics.to_dict(),
    }
    if alone:
        report["stereo_pairs"] = {
            name: one.metrics.to_dict() if one else None for name, one in alone.items()
        }
    write_atomically(out / TRUTH, _tum_of(results.records, at_pairs))
    write_json(out / EVALUATION, report)
    return comparison


def compare(
    results: Results,
    truth_at_pairs: Array,
    *,
    alignment: Alignment = "se3",
    lengths_m: tuple[float, ...] | None = None,
) -> Comparison:
    """Compare results with (N, 4, 4) truth of the same body; InputError where they do not meet."""
    estimate = poses_of(results.records)
    if (has_pose(estimate) & has_pose(truth_at_pairs)).sum() < 2:
        raise InputError(
            f"{results.path}: fewer than two pairs have both a pose and truth; do the times (or"
            " the numbers of the pairs) of the two agree?"
        )
    metrics = evaluate_trajectory(
        estimate=estimate,
        truth=truth_at_pairs,
        covariances=covariances_of(results.records),
        alignment=alignment,
        lengths_m=lengths_m,
    )
    return Comparison(results, truth_at_pairs, metrics)


def _alone(
    results: Results,
    truth: TruthPoses,
    alignment: Alignment,
    lengths_m: tuple[float, ...] | None,
) -> dict[str, Comparison | None]:
    """Return the comparison of each stereo pair by itself, of a run that joined several."""
    figures: dict[str, Comparison | None] = {}
    for name, records in read_pair_records(results).items():
        try:
            own = replace(results, records=records)
            figures[name] = compare(
                own, truth.at(records), alignment=alignment, lengths_m=lengths_m
            )
        except InputError:
            figures[name] = None
    return figures


def covariances_of(records: Sequence[PoseRecord]) -> Array | None:
    """Return the (N, 6, 6) covariances, NaN where there is none; None where none has any."""
    covariances = np.full((len(records), 6, 6), np.nan)
    for at, record in enumerate(records):
        if record.covariance is not None:
            covariances[at] = record.covariance
    return covariances if np.isfinite(covariances).any() else None


def _truth(results: Results, path: Path | None, truth_of: Body | None) -> TruthPoses:
    """Return the truth, its poses those of the body whose poses the results hold."""
    if path is None:
        path = results.path / TRUTH
        if not path.exists():
            raise InputError(f"{results.path} came without truth; give it with --truth PATH")
        return load_truth(path)
    if not path.exists():
        raise InputError(f"{path} does not exist")
    truth = load_truth(path)
    body: Body = truth_of or truth.body
    wanted: Body = "robot" if results.summary.get("body") == "robot" else "left"
    if body == wanted:
        return truth
    poses = truth.poses
    if body == "body":
        recording = results.summary.get("recording", {}).get("path")
        body_from_left = find_body_from_left(path, *([Path(recording)] if recording else []))
        if body_from_left is None:
            raise InputError(
                f"{path} holds poses of the body, and no sensor.yaml with T_BS beside it or in the"
                " recording tells where the left camera sits; give --truth-of left if it is the"
                " camera's"
            )
        poses = poses @ body_from_left
    robot_from_left = _robot_from_left(results)
    if wanted == "robot":
        poses = poses @ inverse(robot_from_left)
    elif body == "robot":
        poses = poses @ (
            robot_from_left if truth.robot_from_left is None else truth.robot_from_left
        )
    return replace(truth, poses=poses, body=wanted)


def _robot_from_left(results: Results) -> Array:
    """Return (4, 4) from the calibration the run used; the identity where it names no robot."""
    from pilotage.calibration.files import load_rig

    robot_from_left = load_rig(results.path / CALIBRATION).robot_from_left
    return np.eye(4) if robot_from_left is None else np.asarray(robot_from_left.matrix())


def _tum_of(records: Sequence[PoseRecord], poses: Array) -> str:
    from scipy.spatial.transform import Rotation

    lines = ["# truth at the pairs of this run: t[s] x y z qx qy qz qw\n"]
    for record, pose in zip(records, poses, strict=True):
        if np.isfinite(pose).all():
            w, x, y, z = Rotation.from_matrix(pose[:3, :3]).as_quat(scalar_first=True).tolist()
            position = pose[:3, 3].tolist()
            held = PoseRecord(
                record.index,
                record.timestamp_ns,
                "tracking",
                position_m=(position[0], position[1], position[2]),
                quaternion_wxyz=(w, x, y, z),
            )
            lines.append(tum_line(held))
    return "".join(lines)
