# SPDX-License-Identifier: Apache-2.0
"""Errors of reconstructed poses against cases whose answer is known, and against evo."""

from __future__ import annotations

import numpy as np
import pytest
from evo.core.metrics import APE, PoseRelation
from evo.core.trajectory import PosePath3D
from scipy.spatial.transform import Rotation

from pilotage.evaluation.camera_poses import pose_errors
from pilotage.evaluation.poses import Similarity


def a_walk(count: int = 30, seed: int = 3) -> np.ndarray:
    random = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(random.normal(0, 0.4, (count, 3))).as_matrix()
    poses[:, :3, 3] = np.cumsum(random.normal(0, 0.3, (count, 3)), axis=0)
    return poses


def elsewhere(poses: np.ndarray, scale: float = 0.2) -> np.ndarray:
    rotation = Rotation.from_euler("xyz", (20, -130, 75), degrees=True).as_matrix()
    return Similarity(rotation, np.array([3.0, -2.0, 5.0]), scale).apply(poses)


def noisy(poses: np.ndarray) -> np.ndarray:
    random = np.random.default_rng(9)
    result = poses.copy()
    result[:, :3, 3] += random.normal(0, 0.05, (len(poses), 3))
    result[:, :3, :3] @= Rotation.from_rotvec(random.normal(0, 0.02, (len(poses), 3))).as_matrix()
    return result


def test_another_world_and_scale_are_no_error():
    errors = pose_errors(estimate=elsewhere(a_walk()), truth=a_walk())
    assert errors is not None
    assert errors.compared == 30
    assert errors.ate_max_m < 1e-9
    assert errors.rotation_max_deg < 1e-5
    assert errors.scale == pytest.approx(5.0)


def test_errors_agree_with_evo():
    truth, estimate = a_walk(), elsewhere(noisy(a_walk()))
    errors = pose_errors(estimate=estimate, truth=truth)
    reference, path = PosePath3D(poses_se3=list(truth)), PosePath3D(poses_se3=list(estimate))
    path.align(reference, correct_scale=True)
    ape = APE(PoseRelation.translation_part)
    ape.process_data((reference, path))
    assert errors is not None
    assert errors.ate_rmse_m == pytest.approx(ape.get_all_statistics()["rmse"], abs=1e-9)
    assert errors.ate_median_m == pytest.approx(ape.get_all_statistics()["median"], abs=1e-9)
    way_m = np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1).sum()
    assert errors.ate_percent_of_length == pytest.approx(100 * errors.ate_rmse_m / way_m)


def test_a_turned_camera_is_a_rotation_error_alone():
    truth, estimate = a_walk(), elsewhere(a_walk())
    estimate[4, :3, :3] @= Rotation.from_rotvec((0, 0.1, 0)).as_matrix()
    errors = pose_errors(estimate=estimate, truth=truth)
    assert errors is not None
    assert errors.ate_max_m < 1e-9
    assert errors.rotation_max_deg == pytest.approx(np.degrees(0.1), rel=0.05)
    assert errors.rotation_median_deg < np.degrees(0.1) / 20


def test_a_straight_row_of_cameras_leaves_no_turn_open():
    truth = a_walk()
    truth[:, :3, 3] = np.arange(len(truth))[:, None] * (1.0, 0.0, 0.0)
    errors = pose_errors(estimate=elsewhere(truth), truth=truth)
    assert errors is not None
    assert errors.ate_max_m < 1e-9
    assert errors.rotation_max_deg < 1e-5


def test_pictures_that_are_not_registered_do_not_count():
    truth, estimate = a_walk(), elsewhere(a_walk())
    estimate[3:20] = np.nan
    truth[25] = np.nan
    errors = pose_errors(estimate=estimate, truth=truth)
    assert errors is not None
    assert errors.compared == 12
    assert errors.ate_max_m < 1e-9


def test_two_pictures_tell_nothing():
    truth, estimate = a_walk(), elsewhere(a_walk())
    estimate[2:] = np.nan
    assert pose_errors(estimate=estimate, truth=truth) is None
