# SPDX-License-Identifier: Apache-2.0
"""Metrics against cases whose answer is known, and against evo."""

from __future__ import annotations

import copy
from pathlib import Path

import numpy as np
import pytest
from evo.core.metrics import APE, PoseRelation
from evo.core.trajectory import PosePath3D
from scipy.spatial.transform import Rotation

from pilotage.errors import InputError
from pilotage.evaluation.metrics import (
    SEGMENT_LENGTHS_M,
    distance_along,
    evaluate_trajectory,
    nees,
    position_errors,
    segment_errors,
    segment_lengths,
)
from pilotage.evaluation.poses import align, interpolate, inverse
from pilotage.evaluation.truth import load_truth
from pilotage.pose_files import PoseRecord


def moved(rotation_deg: tuple[float, float, float], position_m: tuple[float, float, float]):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", rotation_deg, degrees=True).as_matrix()
    pose[:3, 3] = position_m
    return pose


def street(pairs: int = 121, step_m: float = 0.5) -> np.ndarray:
    """Poses along a straight line of 60 m, exactly `step_m` apart, looking where they go."""
    poses = np.tile(np.eye(4), (pairs, 1, 1))
    poses[:, 2, 3] = step_m * np.arange(pairs)
    return poses


def winding(pairs: int = 200, seed: int = 1) -> np.ndarray:
    """Poses that turn and shake along a bent path."""
    random = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (pairs, 1, 1))
    for at in range(1, pairs):
        step = moved(tuple(random.normal(0, 1.5, 3)), tuple(random.normal([0, 0, 0.4], 0.05)))
        poses[at] = poses[at - 1] @ step
    return poses


def noisy(poses: np.ndarray, seed: int = 2) -> np.ndarray:
    random = np.random.default_rng(seed)
    return poses @ np.array(
        [moved(tuple(random.normal(0, 0.2, 3)), tuple(random.normal(0, 0.03, 3))) for _ in poses]
    )


def scaled(poses: np.ndarray, scale: float) -> np.ndarray:
    larger = poses.copy()
    larger[:, :3, 3] *= scale
    return larger


def test_path_one_percent_too_long():
    metrics = evaluate_trajectory(estimate=scaled(street(), 1.01), truth=street())
    assert metrics.translation_percent == pytest.approx(1.0, abs=1e-9)
    assert metrics.scale == pytest.approx(1.01)
    assert metrics.end_error_percent == pytest.approx(1.0)
    assert metrics.end_error_m == pytest.approx(0.6)
    assert [segment.length_m for segment in metrics.segments] == list(SEGMENT_LENGTHS_M)
    assert [segment.segments for segment in metrics.segments] == [101, 81, 61, 41]
    # Residuals of a 1 % too long line about its middle: 1 % of the rms distance from the middle.
    along = street()[:, 2, 3]
    assert metrics.ate_rmse_m == pytest.approx(0.01 * along.std())


def test_steady_turn_is_found_as_rotation_error():
    truth = street()
    turned = truth.copy()
    for at in range(len(turned)):
        turned[at, :3, :3] = Rotation.from_euler("y", 0.01 * at, degrees=True).as_matrix()
    metrics = evaluate_trajectory(estimate=turned, truth=truth)
    assert metrics.rotation_deg_m == pytest.approx(0.02)
    assert metrics.rpe_rotation_rmse_deg == pytest.approx(0.01)


def test_other_world_is_no_error():
    truth = winding()
    metrics = evaluate_trajectory(estimate=moved((10, -70, 130), (5, -3, 8)) @ truth, truth=truth)
    assert metrics.ate_max_m < 1e-9
    assert metrics.translation_percent < 1e-9
    assert metrics.end_error_m < 1e-9
    assert metrics.rpe_translation_rmse_m < 1e-9


def test_alignment_none_sees_the_other_world():
    truth = winding()
    shifted = moved((0, 0, 0), (3, 4, 0)) @ truth
    metrics = evaluate_trajectory(estimate=shifted, truth=truth, alignment="none")
    assert metrics.ate_rmse_m == pytest.approx(5.0)


@pytest.mark.parametrize("with_scale", [False, True])
def test_ate_agrees_with_evo(with_scale: bool):
    truth, estimate = winding(), moved((1, 2, 3), (4, 5, 6)) @ scaled(noisy(winding()), 1.03)
    reference, path = PosePath3D(poses_se3=list(truth)), PosePath3D(poses_se3=list(estimate))
    path.align(reference, correct_scale=with_scale)
    ape = APE(PoseRelation.translation_part)
    ape.process_data((reference, path))
    fit = align(points_in_a=estimate[:, :3, 3], points_in_b=truth[:, :3, 3], with_scale=with_scale)
    errors = np.linalg.norm(fit.apply(estimate)[:, :3, 3] - truth[:, :3, 3], axis=1)
    np.testing.assert_allclose(errors, ape.error, atol=1e-9)


def test_inputs_stay_as_they_were():
    truth, estimate = winding(), noisy(winding())
    before = copy.deepcopy((truth, estimate))
    evaluate_trajectory(estimate=estimate, truth=truth, covariances=np.tile(np.eye(6), (200, 1, 1)))
    np.testing.assert_array_equal(truth, before[0])
    np.testing.assert_array_equal(estimate, before[1])


def test_lost_pairs_count_and_do_not_hide_an_error_behind_them():
    truth, estimate = street(), street()
    estimate[60:] = moved((0, 0, 0), (0, 0, 2)) @ estimate[60:]
    estimate[50:60] = np.nan
    metrics = evaluate_trajectory(estimate=estimate, truth=truth)
    assert (metrics.lost, metrics.compared) == (10, 111)
    # Only segments across the gap are wrong, by 2 m; 10 m is 20 pairs, so starts 40..49 count.
    assert metrics.segments[0].translation_percent == pytest.approx(20 * 10 / (101 - 10 - 10))
    assert metrics.rpe_translation_rmse_m < 1e-12


def test_segments_follow_the_path_where_it_is_short():
    assert segment_lengths(16.0) == pytest.approx(tuple(1.6 * share for share in range(1, 9)))
    assert segment_lengths(60.0) == SEGMENT_LENGTHS_M
    short = street(pairs=21, step_m=0.1)
    table, _ = segment_errors(scaled(short, 0.98), short, distance_along(short))
    assert [segment.translation_percent for segment in table] == pytest.approx([2.0] * 8)


def test_standing_still_has_no_error_in_percent():
    truth = np.tile(np.eye(4), (30, 1, 1))
    metrics = evaluate_trajectory(estimate=truth, truth=truth)
    assert np.isnan([metrics.translation_percent, metrics.scale, metrics.end_error_percent]).all()
    assert metrics.origin_error_max_m == 0


def test_too_little_to_compare_is_refused():
    lost = np.full((5, 4, 4), np.nan)
    with pytest.raises(ValueError, match="fewer than two"):
        evaluate_trajectory(estimate=lost, truth=street(5))


def test_nees_of_errors_drawn_from_the_covariance():
    random = np.random.default_rng(7)
    truth = winding(2000)
    half = random.normal(size=(6, 6)) * np.array([[0.1] * 3 + [0.02] * 3]).T
    covariance = half @ half.T
    estimate = truth.copy()
    for at, error in enumerate(random.multivariate_normal(np.zeros(6), covariance, len(truth))):
        if at:
            turn = Rotation.from_rotvec(-error[3:]).as_matrix()
            estimate[at, :3, :3] = turn @ truth[at, :3, :3]
            estimate[at, :3, 3] -= error[:3]
    world = moved((30, 40, 50), (1, 2, 3))
    values = nees(estimate, world @ truth, np.tile(covariance, (len(truth), 1, 1)))
    assert np.isnan(values[0])
    # Mean of 1999 values of variance 12: three standard errors are 0.23.
    assert np.mean(values[1:]) == pytest.approx(6.0, abs=0.23)
    assert np.mean(values[1:] <= 16.812) == pytest.approx(0.99, abs=0.01)


def test_alignment_of_a_line_turns_no_more_than_needed():
    line = street(10)[:, :3, 3]
    fit = align(points_in_a=line, points_in_b=line)
    np.testing.assert_allclose(line @ fit.rotation.T + fit.translation, line, atol=1e-12)
    assert np.linalg.det(fit.rotation) == pytest.approx(1.0)


def test_interpolation_between_samples_and_not_across_gaps():
    times = np.array([0, 100, 200, 900], dtype=np.int64) * 1_000_000 + 1_403_636_579_000_000_000
    poses = np.array([moved((0, 0, 10.0 * k), (k, 0, 0)) for k in range(4)])
    at = times[0] + np.array([50, 100, 550, -50, 900], dtype=np.int64) * 1_000_000
    found = interpolate(times_ns=times, poses=poses, at_ns=at, widest_gap_ns=250_000_000)
    np.testing.assert_allclose(found[0], moved((0, 0, 5), (0.5, 0, 0)), atol=1e-9)
    np.testing.assert_allclose(found[1], poses[1])
    assert np.isnan(found[2:4]).all()
    np.testing.assert_allclose(found[4], poses[3])


def test_position_errors_are_nan_where_unknown():
    estimate = street(10)
    estimate[3] = np.nan
    errors = position_errors(estimate=estimate, truth=street(10), alignment="origin")
    assert np.flatnonzero(np.isnan(errors)).tolist() == [3]


def record(index: int, timestamp_ns: int) -> PoseRecord:
    return PoseRecord(index, timestamp_ns, "lost")


def test_kitti_truth_is_met_by_the_number_of_the_pair(tmp_path: Path):
    poses = winding(6)
    np.savetxt(tmp_path / "poses.txt", poses[:, :3].reshape(-1, 12))
    truth = load_truth(tmp_path / "poses.txt")
    found = truth.at([record(4, 0), record(1, 7), record(9, 8)])
    np.testing.assert_allclose(found[:2], poses[[4, 1]], atol=1e-12)
    assert np.isnan(found[2]).all()


def test_tum_truth_is_of_the_camera_unless_a_body_is_known(tmp_path: Path):
    (tmp_path / "truth.txt").write_text(
        "# t x y z qx qy qz qw\n1.5 1 2 3 0 0 0 1\n1.6 2 2 3 0 0 0 1\n"
    )
    truth = load_truth(tmp_path / "truth.txt")
    assert truth.body == "left"
    np.testing.assert_allclose(truth.at([record(0, 1_550_000_000)])[0, :3, 3], [1.5, 2, 3])


def test_euroc_csv_truth_is_of_the_body(tmp_path: Path):
    rows = "#timestamp,px,py,pz,qw,qx,qy,qz\n1403636580838555648,1,2,3,1,0,0,0,9,9,9\n"
    (tmp_path / "data.csv").write_text(rows)
    truth = load_truth(tmp_path / "data.csv")
    assert truth.body == "body"
    np.testing.assert_allclose(truth.poses[0, :3, 3], [1, 2, 3])


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "no pose"),
        ("1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0\n", "line 2"),
        ("2 0 0 0 0 1 0 0 0 0 1 0\n", "no rotation"),
        ("1.0 0 0 0 0 0 0 word\n", "truth.txt"),
        ("2.0 0 0 0 0 0 0 1\n1.0 0 0 0 0 0 0 1\n", "truth.txt"),
    ],
)
def test_bad_truth_is_refused_with_its_name(tmp_path: Path, content: str, said: str):
    (tmp_path / "truth.txt").write_text(content)
    with pytest.raises(InputError, match=said) as refused:
        load_truth(tmp_path / "truth.txt")
    assert "truth.txt" in str(refused.value)


def test_inverse():
    poses = winding(5)
    np.testing.assert_allclose(inverse(poses) @ poses, np.tile(np.eye(4), (5, 1, 1)), atol=1e-12)
