# SPDX-License-Identifier: Apache-2.0
# Long: scenes, trials and both tables of one benchmark, read from top to bottom.
"""Are poses honest when up to half of the matches are wrong?

    python benchmarks/blunders.py --trials 10000 --seed 0     # confidently wrong poses: none
    python benchmarks/blunders.py --losses --trials 500       # table of docs/robust_losses.md

Each trial draws a stereo rig, a scene, a motion, noise and gross errors (a tenth of them agree on
one rigid motion of their own), then runs find_blunders, resect_ransac and resect on it.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pilotage import _core

Array = NDArray[np.float64]

# Beyond this squared Mahalanobis distance a pose is wrong: chi-square, 6 degrees, 1 - 1e-6.
CONFIDENTLY_WRONG = 38.258
# What the estimator is told; the truth is drawn from 0.2 to 0.5 pixels.
ASSUMED_SIGMA_PX = 0.35
LOSSES = ("none", "danish", "huber", "cauchy", "tukey", "geman_mcclure")
RIGS = (
    _core.RectifiedStereo(
        width_px=1241, height_px=376, focal_px=700.0, cx_px=620.0, cy_px=188.0,
        cx_right_px=620.0, baseline_m=0.5,
    ),
    _core.RectifiedStereo(
        width_px=752, height_px=480, focal_px=458.0, cx_px=376.0, cy_px=240.0,
        cx_right_px=376.0, baseline_m=0.11,
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Trial:
    """Matches of two stereo pairs, (N, 3) rows of left x, left y, right x each."""

    stereo: _core.RectifiedStereo
    previous_px: Array
    current_px: Array
    is_good: NDArray[np.bool_]
    world_from_camera: Array  # (4, 4) true pose of the current left camera in the previous one
    noise_px: float


@dataclass(frozen=True)
class Outcome:
    """What the three steps made of a trial."""

    quality: str  # tracking, degraded, lost
    nees: float  # squared Mahalanobis distance of the pose's error; NaN when lost
    position_error_m: float
    rotation_error_rad: float


def project(stereo: _core.RectifiedStereo, points: Array) -> Array:
    """Return (N, 3) left x, left y, right x in pixels of points (N, 3) in the left camera."""
    scale = stereo.focal_px / points[:, 2]
    return np.column_stack(
        (
            scale * points[:, 0] + stereo.cx_px,
            scale * points[:, 1] + stereo.cy_px,
            scale * (points[:, 0] - stereo.baseline_m) + stereo.cx_right_px,
        )
    )


def triangulate(stereo: _core.RectifiedStereo, seen_px: Array) -> Array:
    """Return (N, 3) points in the left camera, metres, of (N, 3) left x, left y, right x."""
    disparity = seen_px[:, 0] - seen_px[:, 2] - (stereo.cx_px - stereo.cx_right_px)
    depth = stereo.focal_px * stereo.baseline_m / np.maximum(disparity, 0.1)
    return np.column_stack(
        (
            (seen_px[:, 0] - stereo.cx_px) * depth / stereo.focal_px,
            (seen_px[:, 1] - stereo.cy_px) * depth / stereo.focal_px,
            depth,
        )
    )


def small_motion(random: np.random.Generator, step_m: float, angle_rad: float) -> Array:
    """Return a (4, 4) motion: mostly forward, up to step_m, turned by up to about angle_rad."""
    axis = random.normal(size=3) * angle_rad / 2
    angle = np.linalg.norm(axis)
    k = np.cross(np.eye(3), axis / angle)
    motion = np.eye(4)
    motion[:3, :3] = np.eye(3) - np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
    motion[:3, 3] = random.uniform(-0.3, 0.3, 3) * step_m
    motion[2, 3] = random.uniform(0, 1) * step_m
    return motion


def make_trial(random: np.random.Generator, blunder_share: float | None = None) -> Trial:
    """Draw a trial; `blunder_share` in [0, 1], drawn from 0 to 0.5 when None."""
    which = int(random.integers(2))
    stereo = RIGS[which]
    count = int(random.integers(100, 401))
    share = random.uniform(0, 0.5) if blunder_share is None else blunder_share
    noise = random.uniform(0.2, 0.5)
    near, far, step = ((4.0, 40.0, 1.2), (1.0, 8.0, 0.15))[which]
    depth = 1 / random.uniform(1 / far, 1 / near, count)
    rays = np.column_stack(
        (
            (random.uniform(0, stereo.width_px, count) - stereo.cx_px) / stereo.focal_px,
            (random.uniform(0, stereo.height_px, count) - stereo.cy_px) / stereo.focal_px,
            np.ones(count),
        )
    )
    points = rays * depth[:, None]
    world_from_camera = small_motion(random, step, 0.05)
    moved = (points - world_from_camera[:3, 3]) @ world_from_camera[:3, :3]
    previous = project(stereo, points) + random.normal(0, noise, (count, 3))
    current = project(stereo, moved) + random.normal(0, noise, (count, 3))
    bad = random.permutation(count)[: round(share * count)]
    on_mover = bad[: len(bad) // 10]
    lost = bad[len(bad) // 10 :]
    own = small_motion(random, step, 0.05)
    on_its_way = moved[on_mover] @ own[:3, :3].T + own[:3, 3]
    current[on_mover] = project(stereo, on_its_way) + random.normal(0, noise, (len(on_mover), 3))
    # A wrong match is wrong in both pictures, its disparity still plausible.
    current[lost, 0] = random.uniform(0, stereo.width_px, len(lost))
    current[lost, 1] = random.uniform(0, stereo.height_px, len(lost))
    nearest_disparity = stereo.focal_px * stereo.baseline_m / near
    current[lost, 2] = current[lost, 0] - random.uniform(1, nearest_disparity, len(lost))
    is_good = np.ones(count, dtype=np.bool_)
    is_good[bad] = False
    return Trial(stereo, previous, current, is_good, world_from_camera, noise)


def adjust(
    trial: Trial, kept: NDArray[np.intp], start: _core.Transform, loss: str = "danish"
) -> _core.ResectionResult:
    """Resect the current pair from the matches `kept` (indices)."""
    points = triangulate(trial.stereo, trial.previous_px[kept])
    options = _core.ResectionOptions()
    options.loss = getattr(_core.RobustLoss, loss)
    return _core.resect(
        points_in_world=points,
        observed_px=trial.current_px[kept],
        stereo=trial.stereo,
        camera_from_world=start,
        left_sigma_px=ASSUMED_SIGMA_PX,
        right_sigma_px=ASSUMED_SIGMA_PX,
        options=options,
        point_covariances=covariances(trial, points),
    )


def covariances(trial: Trial, points: Array) -> Array:
    """Return (N, 3, 3) covariances of triangulated points."""
    return _core.stereo_point_covariances(
        points_in_left=points,
        stereo=trial.stereo,
        left_sigma_px=ASSUMED_SIGMA_PX,
        right_sigma_px=ASSUMED_SIGMA_PX,
    )


def search(trial: Trial, seed: int) -> tuple[NDArray[np.intp], _core.Transform | None]:
    """Run find_blunders and resect_ransac; return the indices kept and the pose, None if lost."""
    epipolar = _core.EpipolarOptions()
    epipolar.seed = seed
    check = _core.find_blunders(
        points_a=np.ascontiguousarray(trial.previous_px[:, :2]),
        points_b=np.ascontiguousarray(trial.current_px[:, :2]),
        options=epipolar,
    )
    kept = np.flatnonzero(check.inlier)
    points = triangulate(trial.stereo, trial.previous_px[kept])
    options = _core.PoseRansacOptions()
    options.seed = seed
    found = _core.resect_ransac(
        points_in_previous=points,
        observed_px=trial.current_px[kept],
        stereo=trial.stereo,
        left_sigma_px=ASSUMED_SIGMA_PX,
        right_sigma_px=ASSUMED_SIGMA_PX,
        options=options,
        point_covariances=covariances(trial, points),
    )
    return kept[found.inlier], found.camera_from_points


def evaluate(trial: Trial, result: _core.ResectionResult, quality: str) -> Outcome:
    """Compare a pose with the truth."""
    if result.camera_from_world is None:
        return Outcome("lost", np.nan, np.nan, np.nan)
    error = trial.world_from_camera @ result.camera_from_world.matrix()
    skew = (error[:3, :3] - error[:3, :3].T) / 2
    # Small angles: the rotation vector is the skew part to third order.
    twist = np.concatenate((error[:3, 3], (skew[2, 1], skew[0, 2], skew[1, 0])))
    nees = float(twist @ np.linalg.solve(result.covariance, twist))
    position = trial.world_from_camera[:3, 3] - result.camera_from_world.inverse().matrix()[:3, 3]
    return Outcome(quality, nees, float(np.linalg.norm(position)), float(np.linalg.norm(twist[3:])))


def run_trial(trial: Trial, seed: int) -> tuple[Outcome, Outcome]:
    """Return the outcome of the three steps, and of the last step told the good matches."""
    truth = _core.Transform.from_matrix(np.linalg.inv(trial.world_from_camera))
    told = evaluate(trial, adjust(trial, np.flatnonzero(trial.is_good), truth), "tracking")
    kept, start = search(trial, seed)
    if start is None:
        return Outcome("lost", np.nan, np.nan, np.nan), told
    result = adjust(trial, kept, start)
    median_depth = float(np.median(triangulate(trial.stereo, trial.previous_px[kept])[:, 2]))
    quality = _core.judge(result=result, matches=len(trial.is_good), median_depth_m=median_depth)
    return evaluate(trial, result, quality.name), told


@dataclass(frozen=True)
class Summary:
    """Counts and mean errors of many trials."""

    trials: int
    tracking: int
    degraded: int
    lost: int
    confidently_wrong: int
    mean_nees: float  # of those tracking; 6 when covariances are right
    position_ratio: float  # mean error of those tracking over that of knowing the good matches
    rotation_ratio: float


def run(trials: int, seed: int) -> Summary:
    """Run `trials` seeded trials."""
    pairs = []
    for number in range(trials):
        trial = make_trial(np.random.default_rng((seed, number)))
        pairs.append(run_trial(trial, number))
    tracking = [(o, told) for o, told in pairs if o.quality == "tracking"]
    nees = np.array([o.nees for o, _ in tracking])

    def ratio(name: str) -> float:
        ours = np.mean([getattr(o, name) for o, _ in tracking])
        return float(ours / np.mean([getattr(told, name) for _, told in tracking]))

    return Summary(
        trials=trials,
        tracking=len(tracking),
        degraded=sum(o.quality == "degraded" for o, _ in pairs),
        lost=sum(o.quality == "lost" for o, _ in pairs),
        # NaN counts as wrong: it must not pass for honest.
        confidently_wrong=int(np.sum(~(nees <= CONFIDENTLY_WRONG))),
        mean_nees=float(np.mean(nees)),
        position_ratio=ratio("position_error_m"),
        rotation_ratio=ratio("rotation_error_rad"),
    )


def compare_losses(trials: int, seed: int, *, filtered: bool) -> list[str]:
    """Return rows of a Markdown table: mean position error over that of knowing the good matches.

    filtered: the loss sees what resect_ransac kept; otherwise every match, from the same start.
    """
    shares = (0.0, 0.1, 0.3, 0.5)
    rows = []
    for loss in LOSSES:
        cells = []
        for share in shares:
            ours, told, wrong = [], [], 0
            for number in range(trials):
                trial = make_trial(np.random.default_rng((seed, number)), share)
                truth = _core.Transform.from_matrix(np.linalg.inv(trial.world_from_camera))
                kept, start = search(trial, number)
                if start is None:
                    continue
                every = kept if filtered else np.arange(len(trial.is_good))
                outcome = evaluate(trial, adjust(trial, every, start, loss), "tracking")
                best = adjust(trial, np.flatnonzero(trial.is_good), truth, "none")
                ours.append(outcome.position_error_m)
                told.append(evaluate(trial, best, "tracking").position_error_m)
                wrong += not outcome.nees <= CONFIDENTLY_WRONG
            cells.append(f"{np.nanmean(ours) / np.nanmean(told):.3f} ({wrong})")
        rows.append(f"| {loss} | " + " | ".join(cells) + " |")
    return rows


def main() -> None:
    """Parse the command line, run, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--losses", action="store_true", help="compare the robust losses instead")
    arguments = parser.parse_args()
    if arguments.losses:
        for filtered in (True, False):
            print("after RANSAC" if filtered else "on every match")
            print("| loss | 0 % | 10 % | 30 % | 50 % |\n|---|---|---|---|---|")
            print("\n".join(compare_losses(arguments.trials, arguments.seed, filtered=filtered)))
        return
    started = time.perf_counter()
    summary = run(arguments.trials, arguments.seed)
    print(
        "| trials | tracking | degraded | lost | confidently wrong "
        "| mean NEES (6) | position | rotation |"
    )
    print("|---|---|---|---|---|---|---|---|")
    print(
        f"| {summary.trials} | {summary.tracking} | {summary.degraded} | {summary.lost} "
        f"| {summary.confidently_wrong} | {summary.mean_nees:.2f} "
        f"| {summary.position_ratio:.3f} | {summary.rotation_ratio:.3f} |"
    )
    print(f"{time.perf_counter() - started:.0f} s")


if __name__ == "__main__":
    main()
