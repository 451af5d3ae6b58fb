# SPDX-License-Identifier: Apache-2.0
"""Figures of a run against truth, and the goals they are held against."""

from __future__ import annotations

import json
import math
import operator
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from chance import largest_by_chance, ordinary_limit

from pilotage.evaluation.metrics import evaluate_trajectory, has_pose, nees, relative_errors
from pilotage.evaluation.poses import interpolate

Array = npt.NDArray[Any]
# The zed_steps recording has its truth in words: each picture 100 mm beside the last.
ZED_STEP_M = 0.100


@dataclass(frozen=True)
class TruthSigma:
    """How good the truth is: part of what may lie between it and a pose."""

    position_m: float = 1e-6
    way_share: float = 0.0  # of the way since the first pose
    rotation_rad: float = 1e-6


def truth_sigma(name: str) -> TruthSigma:
    """Return the sigma of a recording's truth by its name; rendered truth is exact."""
    if name.startswith("kitti"):
        return TruthSigma(position_m=0.01, way_share=0.003, rotation_rad=0.002)
    if name.startswith("euroc"):
        return TruthSigma(position_m=0.001, rotation_rad=0.003)
    return TruthSigma()


def truth_at(recording: Any, timestamps_ns: Array) -> Array | None:
    """Return (N, 4, 4) true world_from_left, NaN where unknown; None when there is no truth."""
    truth = recording.truth()
    if truth is None:
        return None
    return interpolate(
        times_ns=truth.timestamps_ns,
        poses=truth.world_from_left,
        at_ns=np.asarray(timestamps_ns, np.int64),
        widest_gap_ns=250_000_000,
    )


def judge(name: str, run: Mapping[str, Array], truth: Array | None) -> dict[str, float]:
    """Return the figures of one run by name; missing where the data cannot tell.

    Where truth is there but the system gave too few poses, its errors are infinite: being lost is
    no way to reach a goal.
    """
    poses = run["final_poses"]
    figures = {"lost": float((~has_pose(run["live_poses"])).sum()), **_alarm(str(run["check"]))}
    if name == "zed_steps":
        figures |= _zed_figures(poses)
    if truth is None:
        return figures
    if (has_pose(poses) & has_pose(truth)).sum() < 2:
        errors = ("segment_percent", "ate_m", "ate_live_m", "rest_m", "step_median_m")
        return figures | dict.fromkeys(errors, math.inf) | {"steps_solved": 0.0}
    metrics = evaluate_trajectory(estimate=poses, truth=truth)
    known_live = has_pose(run["live_poses"]).sum() >= 2
    live = evaluate_trajectory(estimate=run["live_poses"] if known_live else poses, truth=truth)
    return figures | {
        "segment_percent": metrics.translation_percent,
        "ate_m": metrics.ate_rmse_m,
        "ate_live_m": live.ate_rmse_m,
        "scale": metrics.scale,
        "end_percent": metrics.end_error_percent,
        "rest_m": live.origin_error_max_m,
        **_step_figures(poses, run["final_segment"], truth),
        **_nees_figures(name, run, truth),
    }


def _alarm(check: str) -> dict[str, float]:
    """Return whether the rig was said not to fit; nothing of a system that does not check it."""
    verdict = json.loads(check).get("verdict")
    return {} if verdict is None else {"alarm": float(verdict == "inconsistent")}


def _zed_figures(poses: Array) -> dict[str, float]:
    steps_m = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    errors = np.abs(steps_m - ZED_STEP_M)
    solved = np.isfinite(errors)
    # Every step counts: one that was not solved is infinitely wrong.
    worst = float(errors.max()) if solved.all() else math.inf
    return {"step_max_m": worst, "steps_solved": float(solved.sum())}


def _step_figures(poses: Array, segment: Array, truth: Array) -> dict[str, float]:
    """Steps between neighbours: solved ones are tied and not further off than a gross error."""
    known = has_pose(poses) & has_pose(truth)
    start = np.flatnonzero(known[:-1] & known[1:] & (segment[:-1] == segment[1:]))
    if not len(start):
        return {"steps_solved": 0.0}
    errors_m = relative_errors(poses, truth, start, start + 1)[:, 0]
    lengths_m = np.linalg.norm(truth[start + 1, :3, 3] - truth[start, :3, 3], axis=1)
    gross = errors_m > np.maximum(0.05, 0.1 * lengths_m)
    return {
        "steps_solved": float((~gross).sum()),
        "steps_wrong": float(gross.sum()),
        "step_median_m": float(np.median(errors_m[~gross])) if (~gross).any() else math.nan,
        "step_max_m": float(errors_m.max()),
    }


def _nees_figures(name: str, run: Mapping[str, Array], truth: Array) -> dict[str, float]:
    """How the live poses' covariances hold: share within 99 %, and poses confidently wrong.

    Confidently wrong is a NEES that chance would not give once in a hundred whole runs.
    """
    covariances = run["live_covariances"] + _truth_covariances(name, truth)
    values = nees(run["live_poses"], truth, covariances)
    values = values[np.isfinite(values)]
    if not len(values):
        return {}
    return {
        "nees_mean": float(values.mean()),
        "nees_share": float((values <= ordinary_limit()).mean()),
        "confidently_wrong": float((values > largest_by_chance(len(values))).sum()),
    }


def _truth_covariances(name: str, truth: Array) -> Array:
    """Return (N, 6, 6): how far the truth itself may be off, relative to its first pose."""
    sigma = truth_sigma(name)
    steps = np.nan_to_num(np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1))
    way_m = np.concatenate([[0.0], np.cumsum(steps)])
    position = 2 * sigma.position_m**2 + (sigma.way_share * way_m) ** 2
    # The first pose's wrong heading swings all that follows about it.
    position += (sigma.rotation_rad * way_m) ** 2
    covariances = np.zeros((len(truth), 6, 6))
    covariances[:, range(3), range(3)] = position[:, None]
    covariances[:, range(3, 6), range(3, 6)] = 2 * sigma.rotation_rad**2
    return covariances


@dataclass(frozen=True)
class Goal:
    """One figure of one recording that must be reached."""

    recording: str
    key: str
    sense: str  # "<=", ">=" or "=="
    limit: float
    every: int = 1

    def is_met(self, figures: Mapping[str, float]) -> bool | None:
        """Tell whether `figures` reach the goal; None when they do not hold it."""
        value = figures.get(self.key, math.nan)
        if math.isnan(value):
            return None
        compare = {"<=": operator.le, ">=": operator.ge, "==": operator.eq}[self.sense]
        return bool(compare(value, self.limit))


def _cost_goals(recording: str, cpu_ms: float) -> list[Goal]:
    return [
        Goal(recording, "cpu_ms", "<=", cpu_ms),
        Goal(recording, "cpu_ratio", ">=", 7),
        Goal(recording, "peak_mb", "<=", 150),
    ]


GOALS = [
    # An error is only worth its name when no pair was left out of it.
    *[Goal(name, "lost", "==", 0) for name in ("kitti_a", "kitti_c", "euroc_a", "euroc_still")],
    Goal("kitti_a", "segment_percent", "<=", 0.60),
    Goal("kitti_a", "ate_m", "<=", 0.045),
    Goal("kitti_a", "alarm", "==", 0),
    *_cost_goals("kitti_a", 12),
    Goal("kitti_b", "alarm", "==", 1),
    Goal("kitti_c", "segment_percent", "<=", 0.95),
    Goal("kitti_c", "ate_m", "<=", 0.115),
    Goal("kitti_c", "alarm", "==", 0),
    *_cost_goals("kitti_c", 12),
    Goal("euroc_a", "ate_m", "<=", 0.0035),
    Goal("euroc_a", "alarm", "==", 0),
    *_cost_goals("euroc_a", 8),
    Goal("zed_steps", "step_max_m", "<=", 0.004),
    Goal("zed_steps", "steps_solved", "==", 7),
    Goal("euroc_keyframes", "steps_solved", ">=", 97),
    Goal("euroc_keyframes", "step_median_m", "<=", 0.006),
    Goal("euroc_still", "rest_m", "<=", 0.002),
    Goal("kitti_c", "confidently_wrong", "==", 0, every=3),
    Goal("kitti_c", "steps_wrong", "==", 0, every=3),
    Goal("euroc_a", "confidently_wrong", "==", 0, every=3),
    Goal("euroc_a", "steps_wrong", "==", 0, every=3),
]
