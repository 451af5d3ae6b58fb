# SPDX-License-Identifier: Apache-2.0
"""The bundle adjustment against SciPy on the same problem, and its border with Python."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pilotage import RectifiedStereo, Transform, _core

Array = NDArray[np.float64]
STEREO = RectifiedStereo(
    width_px=752, height_px=480, focal_px=440.0, cx_px=370.0, cy_px=240.0, cx_right_px=366.0,
    baseline_m=0.11,
)  # fmt: skip


@dataclass
class Scene:
    """A short drive; poses (F, 6) are (centre, rotation vector), measured (N, 3) may hold NaN."""

    poses: Array
    points: Array
    frames: NDArray[np.int32]
    indices: NDArray[np.int32]
    measured: Array
    sigmas: Array

    def problem(self, fixed: int = 1) -> "_core.BundleProblem":
        return _core.BundleProblem(
            stereo=STEREO,
            world_from_left=[transform(pose) for pose in self.poses],
            pose_is_fixed=np.arange(len(self.poses)) < fixed,
            points_in_world=self.points,
            frames=self.frames,
            points=self.indices,
            measured_px=np.hstack([self.measured, self.sigmas]).astype(np.float32),
        )


def transform(pose: Array) -> Transform:
    xyzw = Rotation.from_rotvec(pose[3:]).as_quat()
    return Transform(translation_m=pose[:3], quaternion_wxyz=np.roll(xyzw, 1))


def project(poses: Array, points: Array, scene: Scene) -> Array:
    """(N, 3) pixels: left x, left y, right x."""
    rays = points[scene.indices] - poses[scene.frames, :3]
    rotations = Rotation.from_rotvec(poses[:, 3:]).as_matrix()
    p = np.einsum("nji,nj->ni", rotations[scene.frames], rays)
    left = STEREO.focal_px * p[:, :2] / p[:, 2:] + (STEREO.cx_px, STEREO.cy_px)
    right = STEREO.focal_px * (p[:, 0] - STEREO.baseline_m) / p[:, 2] + STEREO.cx_right_px
    return np.column_stack([left, right])


def make_scene(*, seed: int, blunders: float = 0.0, mono: float = 0.2) -> Scene:
    rng = np.random.default_rng(seed)
    frames, count = 4, 25
    poses = np.zeros((frames, 6))
    poses[:, 2] = 0.3 * np.arange(frames)
    poses[:, 3:] = 0.03 * rng.standard_normal((frames, 3))
    points = rng.uniform((-2, -1.2, 4), (2, 1.2, 9), (count, 3))
    indices, where = np.divmod(np.arange(count * frames, dtype=np.int32), frames)
    scene = Scene(poses, points, where.astype(np.int32), indices.astype(np.int32),
                  np.empty((0, 3)), rng.uniform(0.2, 0.6, (count * frames, 2)))  # fmt: skip
    noise = rng.standard_normal((count * frames, 3)) * scene.sigmas[:, [0, 0, 1]]
    noise += (rng.random((count * frames, 1)) < blunders) * rng.uniform(-20, 20, noise.shape)
    scene.measured = (project(poses, points, scene) + noise).astype(np.float32).astype(float)
    scene.measured[rng.random(len(noise)) < mono, 2] = np.nan
    scene.sigmas = scene.sigmas.astype(np.float32).astype(float)
    scene.poses = poses + 0.01 * rng.standard_normal(poses.shape) * (np.arange(frames) > 0)[:, None]
    scene.points = points + 0.05 * rng.standard_normal(points.shape)
    return scene


def robust_rho(loss: str, v: Array) -> Array:
    """The cost of a residual of v sigmas, half squares near zero."""
    if loss == "huber":
        return np.where(v <= 1.345, 0.5 * v**2, 1.345 * (v - 0.5 * 1.345))
    if loss == "cauchy":
        return 0.5 * 2.3849**2 * np.log1p((v / 2.3849) ** 2)
    return 0.5 * v**2


def robust_residuals(unknowns: Array, scene: Scene, loss: str) -> Array:
    """Residuals whose half sum of squares is the robust cost over whole observations."""
    poses = scene.poses.copy()
    poses[1:] = unknowns[: poses[1:].size].reshape(-1, 6)
    points = unknowns[poses[1:].size :].reshape(-1, 3)
    r = (project(poses, points, scene) - scene.measured) / scene.sigmas[:, [0, 0, 1]]
    components = 2 + np.isfinite(r[:, 2])
    r = np.nan_to_num(r)
    length = np.linalg.norm(r, axis=1)
    cost = components * robust_rho(loss, length / np.sqrt(components))
    return (r * (np.sqrt(2 * cost) / np.maximum(length, 1e-300))[:, None]).ravel()


def precise_options(loss: str) -> "_core.BundleOptions":
    options = _core.BundleOptions()
    options.loss = getattr(_core.RobustLoss, loss)
    options.max_iterations = 200
    options.relative_cost_change = 1e-14
    return options


@pytest.mark.parametrize("loss", ["none", "huber", "cauchy"])
def test_minimum_is_that_of_scipy(loss: str) -> None:
    scene = make_scene(seed=3, blunders=0.05)
    problem = scene.problem()
    result = _core.adjust_bundle(problem=problem, options=precise_options(loss))
    start = np.concatenate([scene.poses[1:].ravel(), scene.points.ravel()])
    expected = least_squares(
        robust_residuals, start, args=(scene, loss), x_scale="jac", xtol=1e-12, ftol=1e-13,
        gtol=1e-10, max_nfev=200,
    )  # fmt: skip
    assert result.final_cost == pytest.approx(expected.cost, rel=1e-6)
    count = scene.poses[1:].size
    centres = np.array([pose.translation_m for pose in problem.world_from_left])
    assert np.allclose(centres[1:], expected.x[:count].reshape(-1, 6)[:, :3], atol=2e-6)
    assert np.allclose(problem.points_in_world, expected.x[count:].reshape(-1, 3), atol=1e-5)


def test_each_argument_reaches_its_place() -> None:
    scene = make_scene(seed=1, mono=0.0)
    problem = scene.problem(fixed=4)
    options = precise_options("none")
    options.max_iterations = 0
    result = _core.adjust_bundle(problem=problem, options=options)
    unknowns = np.concatenate([scene.poses[1:].ravel(), scene.points.ravel()])
    expected = robust_residuals(unknowns, scene, "none").reshape(-1, 3)
    assert result.termination == _core.Termination.iteration_limit
    assert np.allclose(result.normalised_residuals, np.linalg.norm(expected, axis=1), rtol=1e-4)
    assert result.initial_cost == pytest.approx(0.5 * (expected**2).sum(), rel=1e-6)
    assert result.residuals == expected.size


def test_covariance_comes_when_asked_and_is_zero_where_fixed() -> None:
    scene = make_scene(seed=2)
    options = precise_options("huber")
    assert _core.adjust_bundle(problem=scene.problem(), options=options).pose_covariances.size == 0
    options.with_covariance = True
    covariances = _core.adjust_bundle(problem=scene.problem(), options=options).pose_covariances
    assert covariances.shape == (4, 6, 6)
    assert not covariances[0].any()
    assert np.linalg.eigvalsh(covariances[1:]).min() > 0


def test_offset_is_found() -> None:
    scene = make_scene(seed=4, mono=0.0)
    scene.measured[:, 2] += 0.75
    problem = scene.problem()
    problem.right_x_offset_is_free = True
    result = _core.adjust_bundle(problem=problem, options=precise_options("huber"))
    sigma = result.right_x_offset_sigma_px
    assert 0 < sigma < 1
    assert abs(problem.right_x_offset_px - 0.75) < 4 * sigma


def test_marginalised_frame_lives_on_as_prior() -> None:
    scene = make_scene(seed=5)
    problem = scene.problem()
    _core.marginalize_first_frame(problem=problem)
    assert len(problem.world_from_left) == 3
    assert problem.observation_count == 0  # every point was seen by every frame
    assert problem.prior.information.shape == (18, 18)
    moved = problem.world_from_left
    result = _core.adjust_bundle(problem=problem, options=precise_options("huber"))
    shift = problem.world_from_left[1].translation_m - moved[1].translation_m
    assert result.residuals == 0
    assert 0 < np.linalg.norm(shift) < 0.1  # the minimum the observations had spoken for


def test_wrong_arguments_name_the_value() -> None:
    scene = make_scene(seed=6)
    options = _core.BundleOptions()
    options.threads = 0
    with pytest.raises(ValueError, match="threads must be at least 1, got 0"):
        _core.adjust_bundle(problem=scene.problem(), options=options)
    with pytest.raises(TypeError):
        _core.adjust_bundle(scene.problem())
    scene.frames[7] = 4
    with pytest.raises(ValueError, match="frame 4, outside 0 to 3"):
        _core.adjust_bundle(problem=scene.problem())
    scene.frames = scene.frames[:-1]
    with pytest.raises(ValueError, match="equally long, got 99, 100 and 100"):
        scene.problem()
