# SPDX-License-Identifier: Apache-2.0
"""Time an iteration of Pilotage's bundle adjustment beside Ceres on the same problems.

python benchmarks/bundle_adjustment.py [--problem window|block|all] [--repeats N]

Both start from the same poses and points and minimise the same Huber cost, each on one thread.
Ceres (through pyceres) offers Python no compiled reprojection error, so its residuals and Jacobians
are evaluated by Python and their time says nothing: what is compared is the time Ceres spends in
its linear solver (Schur complement, Cholesky, back-substitution) with ALL that Pilotage does in an
iteration, residuals, weights and Jacobians included. The ratio favours Ceres, but for one thing:
its Schur eliminator has no fixed-size code for blocks of 3 residuals, 3 and 6 unknowns.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass

import numpy as np
import pyceres
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pilotage import RectifiedStereo, Transform, _core

Array = NDArray[np.float64]
STEREO = RectifiedStereo(
    width_px=1241, height_px=376, focal_px=718.9, cx_px=607.2, cy_px=185.2, cx_right_px=607.2,
    baseline_m=0.5372,
)  # fmt: skip
HUBER = 1.345 * np.sqrt(3.0)  # Pilotage's threshold on the length of three residuals
SIGMA_PX = 0.5


@dataclass
class Scene:
    """A drive; rotations (F, 3, 3) and centres (F, 3) in the world, observations by point."""

    rotations: Array
    centres: Array
    points: Array
    frames: NDArray[np.int32]
    indices: NDArray[np.int32]
    measured: Array


def make_scene(*, frames: int, points: int, track: int, seed: int = 1) -> Scene:
    """A camera that drives forward through a cloud; each point is followed up to `track` frames."""
    rng = np.random.default_rng(seed)
    steps = np.arange(frames)
    turns = np.column_stack([0.01 * np.sin(0.7 * steps), 0.002 * steps, 0.01 * np.cos(steps)])
    rotations = Rotation.from_rotvec(turns).as_matrix()
    centres = np.column_stack([0.001 * steps**1.5, 0.03 * np.cos(steps), 0.5 * steps])
    hosts = rng.integers(0, frames, points)
    depth = 6.0 + 34.0 * rng.random(points) * rng.random(points)
    pixels = rng.uniform((0, 0), (STEREO.width_px, STEREO.height_px), (points, 2))
    rays = np.column_stack([(pixels - (STEREO.cx_px, STEREO.cy_px)) / STEREO.focal_px, depth**0])
    cloud = np.einsum("nij,nj->ni", rotations[hosts], rays * depth[:, None]) + centres[hosts]
    indices = np.repeat(np.arange(points), track)
    where = (hosts[:, None] - track // 2 + np.arange(track)).ravel()
    inside = (where >= 0) & (where < frames)
    scene = Scene(rotations, centres, cloud, where[inside].astype(np.int32),
                  indices[inside].astype(np.int32), np.empty(0))  # fmt: skip
    pixels, depths = project(scene)
    kept = (depths > 1) & (pixels[:, 0] > 0) & (pixels[:, 0] < STEREO.width_px)
    kept &= (pixels[:, 1] > 0) & (pixels[:, 1] < STEREO.height_px)
    scene.frames, scene.indices = scene.frames[kept], scene.indices[kept]
    noisy = pixels[kept] + SIGMA_PX * rng.standard_normal((kept.sum(), 3))
    scene.measured = noisy.astype(np.float32).astype(float)
    shake = 0.02 * (steps > 0)[:, None]
    scene.centres = centres + shake * rng.standard_normal((frames, 3))
    scene.rotations = Rotation.from_rotvec(
        0.1 * shake * rng.standard_normal((frames, 3))
    ).as_matrix()
    scene.rotations = scene.rotations @ rotations
    scene.points = cloud + 0.05 * rng.standard_normal(cloud.shape)
    return scene


def project(scene: Scene) -> tuple[Array, Array]:
    """Pixels (N, 3) as left x, left y, right x, and depths (N,)."""
    away = scene.points[scene.indices] - scene.centres[scene.frames]
    p = np.einsum("nji,nj->ni", scene.rotations[scene.frames], away)
    right = p[:, 0] - STEREO.baseline_m
    scaled = STEREO.focal_px * np.column_stack([p[:, 0], p[:, 1], right]) / p[:, 2:]
    principal = np.array([STEREO.cx_px, STEREO.cy_px, STEREO.cx_right_px])
    return scaled + principal, p[:, 2]


class Turns:
    """camera_from_world and left Jacobian of SO(3) of one pose, kept while its turn is the same."""

    def __init__(self, rotation: Array) -> None:
        self.rotation = rotation
        self.key = b""
        self.value: tuple[list[float], list[float]] = ([], [])

    def at(self, vector: Array) -> tuple[list[float], list[float]]:
        """Both as nine numbers by rows; series, as turns here stay below 0.1 rad."""
        if vector.tobytes() != self.key:
            x, y, z = vector
            k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            powers = [np.linalg.matrix_power(k, n) / math.factorial(n) for n in range(8)]
            jacobian = sum(power / (n + 1) for n, power in enumerate(powers))
            camera_from_world = self.rotation.T @ sum(powers).T
            self.key = vector.tobytes()
            self.value = (camera_from_world.ravel().tolist(), jacobian.ravel().tolist())
        return self.value


class StereoCost(pyceres.CostFunction):
    """Three residuals of one observation; pose (6,) is (shift of the centre, turn) since start.

    Plain floats: numpy costs ten times as much on three numbers.
    """

    def __init__(self, turns: Turns, centre: Array, measured: Array) -> None:
        super().__init__()
        self.turns = turns
        self.centre: list[float] = centre.tolist()
        self.measured: list[float] = measured.tolist()
        self.set_num_residuals(3)
        self.set_parameter_block_sizes([6, 3])

    def Evaluate(self, parameters, residuals, jacobians):  # type: ignore[no-untyped-def]  # noqa: N802
        """Fill residuals (3,) and, where wanted, row-major Jacobians (3, 6) and (3, 3)."""
        r, turning = self.turns.at(parameters[0][3:])
        a, b, c, *_ = parameters[0].tolist()
        u, v, w = parameters[1].tolist()
        cx, cy, cz = self.centre
        wx, wy, wz = u - cx - a, v - cy - b, w - cz - c
        z = r[6] * wx + r[7] * wy + r[8] * wz
        x = (r[0] * wx + r[1] * wy + r[2] * wz) / z
        y = (r[3] * wx + r[4] * wy + r[5] * wz) / z
        right = x - STEREO.baseline_m / z
        for k, (slope, middle) in enumerate(
            ((x, STEREO.cx_px), (y, STEREO.cy_px), (right, STEREO.cx_right_px))
        ):
            residuals[k] = (STEREO.focal_px * slope + middle - self.measured[k]) / SIGMA_PX
        if jacobians is None:
            return True
        s = STEREO.focal_px / (z * SIGMA_PX)
        by_pose, by_point = [], []
        for axis, slope in ((0, x), (3, y), (0, right)):
            j = [s * (r[axis + i] - slope * r[6 + i]) for i in range(3)]
            turn = (j[1] * wz - j[2] * wy, j[2] * wx - j[0] * wz, j[0] * wy - j[1] * wx)
            by_point += j
            by_pose += [-j[0], -j[1], -j[2]]
            by_pose += [sum(turn[k] * turning[3 * k + i] for k in range(3)) for i in range(3)]
        if jacobians[0] is not None:
            jacobians[0][:] = by_pose
        if jacobians[1] is not None:
            jacobians[1][:] = by_point
        return True


def run_pilotage(scene: Scene, repeats: int) -> tuple[float, int, float]:
    """CPU-ms an iteration (least of the repeats), iterations, final cost."""
    options = _core.BundleOptions()
    options.loss = _core.RobustLoss.huber
    options.max_iterations, options.relative_cost_change = 50, 1e-6
    sigmas = np.full((len(scene.frames), 2), SIGMA_PX)
    matrices = np.tile(np.eye(4), (len(scene.centres), 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = scene.rotations, scene.centres
    best = np.inf
    for _ in range(repeats):
        problem = _core.BundleProblem(
            stereo=STEREO,
            world_from_left=[Transform.from_matrix(m) for m in matrices],
            pose_is_fixed=np.arange(len(matrices)) < 1,
            points_in_world=scene.points,
            frames=scene.frames,
            points=scene.indices,
            measured_px=np.hstack([scene.measured, sigmas]).astype(np.float32),
        )
        begin = time.process_time()
        result = _core.adjust_bundle(problem=problem, options=options)
        best = min(best, 1e3 * (time.process_time() - begin) / result.iterations)
    return best, result.iterations, result.final_cost


def run_ceres(scene: Scene, solver: str) -> tuple[pyceres.SolverSummary, float]:
    """The summary of a solution, and the share of a core that it got."""
    problem, loss = pyceres.Problem(), pyceres.HuberLoss(HUBER)
    poses = [np.zeros(6) for _ in scene.centres]
    turns = [Turns(rotation) for rotation in scene.rotations]
    points = list(scene.points.copy())
    costs = []  # Ceres holds no reference to Python's objects
    for frame, index, measured in zip(scene.frames, scene.indices, scene.measured, strict=True):
        costs.append(StereoCost(turns[frame], scene.centres[frame], measured))
        problem.add_residual_block(costs[-1], loss, [poses[frame], points[index]])
    problem.set_parameter_block_constant(poses[0])
    options = pyceres.SolverOptions()
    options.linear_solver_type = pyceres.LinearSolverType.__members__[solver]
    options.max_num_iterations, options.function_tolerance = 50, 1e-6
    options.num_threads = 1
    options.minimizer_progress_to_stdout = False
    options.logging_type = pyceres.LoggingType.SILENT
    summary = pyceres.SolverSummary()
    wall, cpu = time.perf_counter(), time.process_time()
    pyceres.solve(options, problem, summary)
    return summary, (time.process_time() - cpu) / (time.perf_counter() - wall)


def compare(name: str, scene: Scene, solver: str, repeats: int) -> None:
    """Print both, and their ratio."""
    ours, iterations, cost = run_pilotage(scene, repeats)
    summary, share = run_ceres(scene, solver)
    scale = 1e3 * share  # Ceres measures the clock on the wall
    linear = scale * summary.linear_solver_time_in_seconds / summary.num_linear_solves
    jacobians = scale * summary.jacobian_evaluation_time_in_seconds
    jacobians /= summary.num_jacobian_evaluations
    seen = len(scene.frames)
    print(f"{name}: {len(scene.centres)} frames, {len(scene.points)} points, {seen} observations")
    print(
        f"  Pilotage, whole iteration  {ours:10.3f} CPU-ms, {iterations} iterations, "
        f"cost {cost:.6f}"
    )
    print(
        f"  Ceres, linear solver alone {linear:10.3f} CPU-ms, {summary.num_linear_solves} "
        f"iterations, cost {summary.final_cost:.6f} ({solver})"
    )
    print(f"  Ceres, Jacobians in Python {jacobians:10.0f} CPU-ms, not compared")
    print(f"  ratio of the first two     {linear / ours:10.1f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problem", choices=["window", "block", "all"], default="all")
    parser.add_argument("--repeats", type=int, default=10)
    arguments = parser.parse_args()
    if arguments.problem != "block":
        scene = make_scene(frames=10, points=420, track=8)
        compare("window", scene, "DENSE_SCHUR", arguments.repeats)
    if arguments.problem != "window":
        scene = make_scene(frames=300, points=5000, track=7)
        compare("block", scene, "SPARSE_SCHUR", arguments.repeats)


if __name__ == "__main__":
    main()
