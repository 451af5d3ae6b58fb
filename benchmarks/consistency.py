# SPDX-License-Identifier: Apache-2.0
"""Tell whether reported covariances are those of the errors made (NEES).

    python benchmarks/consistency.py [--runs 100] [--recordings 8] [--pairs 16]

First the estimation alone: seeded drives past random points with Gaussian noise of the sigma that
is told, through a sliding window (adjustment, marginalisation) and through one adjustment of all of
the path. Then StereoOdometry on rendered recordings of an exact rig. A run gives one number: the
squared error of its last pose over its covariance, chi-square with 6 degrees of freedom if honest.
The mean over all runs must lie in its 99 % band. Exit 1 when one is above it: too sure of itself.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from chance import mean_band
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from tables import markdown_table, number

from pilotage import RectifiedStereo, Transform, _core

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

Array = NDArray[np.float64]
SIGMA_PX = 0.3  # of every simulated coordinate
STEREO = RectifiedStereo(
    width_px=752, height_px=480, focal_px=440.0, cx_px=375.5, cy_px=239.5, cx_right_px=375.5,
    baseline_m=0.11,
)  # fmt: skip
EXACT = {"scale_sigma": 0.0, "right_x_offset_prior_px": 0.0}


@dataclass
class Band:
    """NEES of many runs and where chance would put their mean 99 times in 100."""

    nees: Array

    @property
    def mean(self) -> float:
        return float(np.mean(self.nees))

    @property
    def limits(self) -> tuple[float, float]:
        return mean_band(len(self.nees))

    @property
    def verdict(self) -> str:
        low, high = self.limits
        return "too sure" if self.mean > high else "too careful" if self.mean < low else "inside"


@dataclass
class Drive:
    """Simulated sightings: pose (F, 4, 4), point of each and (N, 3) left x, left y, right x."""

    world_from_left: Array
    points_in_world: Array
    frames: NDArray[np.int32]
    points: NDArray[np.int32]
    measured_px: Array


def simulate(frames: int, rng: np.random.Generator) -> Drive:
    """A walk forward with slow turns; each point is seen in at most eight pictures in a row."""
    turn = np.cumsum(rng.normal(0, 0.01, (frames, 3)), axis=0)
    poses = np.tile(np.eye(4), (frames, 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(turn).as_matrix()
    poses[1:, :3, 3] = np.cumsum(poses[:-1, :3, 2] * 0.1, axis=0)
    poses = np.linalg.inv(poses[0]) @ poses
    scene, rows = [], []
    for host in range(-4, frames):
        at = poses[max(host, 0)]
        for _ in range(20):
            pixel = rng.uniform((0, 0), (STEREO.width_px, STEREO.height_px))
            depth = rng.uniform(1.0, 8.0)
            ray = (pixel - (STEREO.cx_px, STEREO.cy_px)) / STEREO.focal_px
            point = at[:3, :3] @ (depth * np.r_[ray, 1.0]) + at[:3, 3]
            first, last = max(host, 0), min(host + 8, frames)
            seen = [(f, *project(poses[f], point)) for f in range(first, last)]
            seen = [s for s in seen if 0 < s[1] < STEREO.width_px and 0 < s[2] < STEREO.height_px]
            if len(seen) > 1:
                rows += [(f, len(scene), x, y, right) for f, x, y, right in seen]
                scene.append(point)
    table = np.array(rows)
    noise = rng.normal(0, SIGMA_PX, (len(table), 3))
    indices = table[:, :2].astype(np.int32)
    return Drive(poses, np.array(scene), indices[:, 0], indices[:, 1], table[:, 2:] + noise)


def project(world_from_left: Array, point: Array) -> tuple[float, float, float]:
    """Pixel left x, left y, right x; far outside when the point is behind."""
    x, y, z = world_from_left[:3, :3].T @ (point - world_from_left[:3, 3])
    if z < 0.3:
        return -1e6, -1e6, -1e6
    u = STEREO.focal_px * x / z
    disparity = STEREO.focal_px * STEREO.baseline_m / z
    return u + STEREO.cx_px, STEREO.focal_px * y / z + STEREO.cy_px, u + STEREO.cx_px - disparity


def make_problem(drive: Drive, estimate: Array, first: int, last: int, prior: Any) -> Any:
    """The frames `first` to `last`, with the points first seen in them, as an adjustment."""
    first_seen = np.full(len(drive.points_in_world), np.iinfo(np.int32).max)
    np.minimum.at(first_seen, drive.points, drive.frames)
    kept = (first_seen[drive.points] >= first) & (drive.frames <= last)
    used, index = np.unique(drive.points[kept], return_inverse=True)
    measured = drive.measured_px[kept]
    sigmas = np.full((len(measured), 2), SIGMA_PX)
    frames = last - first + 1
    problem = _core.BundleProblem(
        stereo=STEREO,
        world_from_left=[Transform.from_matrix(pose) for pose in estimate[first : last + 1]],
        pose_is_fixed=(np.arange(frames) == 0) & (prior is None),
        points_in_world=np.ascontiguousarray(drive.points_in_world[used]),
        frames=(drive.frames[kept] - first).astype(np.int32),
        points=index.astype(np.int32),
        measured_px=np.hstack([measured, sigmas]).astype(np.float32),
    )
    problem.prior = prior
    return problem


def adjust(problem: Any) -> Any:
    options = _core.BundleOptions()
    options.with_covariance = True
    options.max_iterations = 20
    return _core.adjust_bundle(problem=problem, options=options)


def squared_error(found: Array, truth: Array, covariance: Array) -> float:
    """Squared (position, rotation) error along the world's axes, over its covariance."""
    turn = Rotation.from_matrix(found[:3, :3] @ truth[:3, :3].T).as_rotvec()
    error = np.r_[found[:3, 3] - truth[:3, 3], turn]
    return float(error @ np.linalg.solve(covariance, error))


def about_the_pose(left_perturbation: Array, position: Array) -> Array:
    """Covariance of (position, rotation) from that of a left perturbation, both (6, 6)."""
    x, y, z = position
    shift = np.eye(6)
    shift[:3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    return np.asarray(shift @ left_perturbation @ shift.T)


def nees_of_last(problem: Any, result: Any, truth: Array) -> float:
    found = problem.world_from_left[-1].matrix()
    covariance = about_the_pose(result.pose_covariances[-1], found[:3, 3])
    return squared_error(found, truth, covariance)


def estimation_run(seed: int, frames: int = 16, window: int = 8) -> tuple[float, float]:
    """NEES of the last pose: of the window when it got there, and of the whole path at once."""
    drive = simulate(frames, np.random.default_rng(seed))
    estimate = drive.world_from_left.copy()
    prior, first = None, 0
    for last in range(1, frames):
        if last - first + 1 > window:
            leaving = make_problem(drive, estimate, first, last - 1, prior)
            _core.marginalize_first_frame(problem=leaving)
            prior, first = leaving.prior, first + 1
        problem = make_problem(drive, estimate, first, last, prior)
        result = adjust(problem)
        estimate[first : last + 1] = [pose.matrix() for pose in problem.world_from_left]
    truth = drive.world_from_left[-1]
    whole = make_problem(drive, estimate, 0, frames - 1, None)
    whole_result = adjust(whole)
    return nees_of_last(problem, result, truth), nees_of_last(whole, whole_result, truth)


def odometry_run(folder: Path, seed: int, pairs: int) -> tuple[float, float]:
    """NEES of the last pose of a rendered recording: as said at once, and at the end."""
    from synthetic import make_recording

    from pilotage.recordings import open_recording

    rendered = make_recording(folder, frames=pairs, seed=seed)
    recording = open_recording(folder)
    odometry = _core.StereoOdometry(rig=recording.rig, config=_core.OdometryConfig.from_dict(EXACT))
    for frame in recording.frames():
        live = odometry.track(frame.left, frame.right, frame.timestamp_ns)
    truth = rendered.world_from_left[-1]
    final = odometry.finish()[-1]
    return (
        squared_error(live.world_from_left.matrix(), truth, live.covariance),
        squared_error(final.world_from_left.matrix(), truth, final.covariance),
    )


def measure(runs: int, recordings: int, pairs: int) -> dict[str, Band]:
    """Return the bands of everything that was run."""
    bands = {}
    if runs:
        both = np.array([estimation_run(seed) for seed in range(runs)])
        bands["estimation, window"] = Band(both[:, 0])
        bands["estimation, whole path"] = Band(both[:, 1])
    if recordings:
        found = []
        for seed in range(recordings):
            with tempfile.TemporaryDirectory(prefix="pilotage-bench-") as folder:
                found.append(odometry_run(Path(folder), seed, pairs))
        bands["odometry, live"] = Band(np.array(found)[:, 0])
        bands["odometry, final"] = Band(np.array(found)[:, 1])
    return bands


def main() -> int:
    """Measure, print, and judge."""
    summary, _, rest = __doc__.partition("\n")
    parser = argparse.ArgumentParser(
        description=summary, epilog=rest, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=100, help="of the estimation alone")
    parser.add_argument("--recordings", type=int, default=8, help="rendered ones")
    parser.add_argument("--pairs", type=int, default=16, help="of each recording")
    arguments = parser.parse_args()
    bands = measure(arguments.runs, arguments.recordings, arguments.pairs)
    rows = [
        [name, str(len(band.nees)), number(band.mean), " to ".join(map(number, band.limits)),
         number(float(np.median(band.nees))), number(float(band.nees.max())), band.verdict]
        for name, band in bands.items()
    ]  # fmt: skip
    titles = ["what", "runs", "mean NEES", "99 % band", "median", "largest", "verdict"]
    print(markdown_table(titles, rows))
    return int(any(band.verdict == "too sure" for band in bands.values()))


if __name__ == "__main__":
    sys.exit(main())
