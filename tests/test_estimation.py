# SPDX-License-Identifier: Apache-2.0
"""Blunders, resection and their covariance through the bindings; the benchmark in small."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from pilotage import _core

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

import blunders


@pytest.fixture(scope="module")
def trial() -> blunders.Trial:
    return blunders.make_trial(np.random.default_rng(5), 0.4)


def test_no_trial_is_confidently_wrong() -> None:
    summary = blunders.run(trials=300, seed=1)
    assert summary.confidently_wrong == 0
    assert summary.tracking >= 290
    # 99 % band of the mean of 300 chi-squares of 6 degrees is +- 0.52; an estimated sigma0 and
    # what few blunders are kept add to it.
    assert 5.4 < summary.mean_nees < 6.9
    assert summary.position_ratio < 1.05
    assert summary.rotation_ratio < 1.05


def test_mostly_blunders_are_never_tracking() -> None:
    for number in range(30):
        trial = blunders.make_trial(np.random.default_rng((9, number)), 0.97)
        outcome, _ = blunders.run_trial(trial, number)
        wrong = not outcome.nees <= blunders.CONFIDENTLY_WRONG
        assert not (outcome.quality == "tracking" and wrong)


def test_blunders_are_found(trial: blunders.Trial) -> None:
    check = _core.find_blunders(
        points_a=trial.previous_px[:, :2].copy(), points_b=trial.current_px[:, :2].copy()
    )
    assert check.ok
    assert not check.degenerate
    assert check.inlier.dtype == np.bool_
    assert np.mean(check.inlier[trial.is_good]) > 0.97
    assert np.mean(check.inlier[~trial.is_good]) < 0.3
    assert check.fundamental.shape == (3, 3)


def test_the_same_input_gives_the_same_bits(trial: blunders.Trial) -> None:
    first, second = (blunders.search(trial, seed=3) for _ in range(2))
    assert np.array_equal(first[0], second[0])
    assert first[1] is not None
    assert second[1] is not None
    assert np.array_equal(first[1].matrix(), second[1].matrix())


def test_lost_comes_without_a_pose() -> None:
    none = np.empty((0, 3))
    found = _core.resect_ransac(points_in_previous=none, observed_px=none, stereo=blunders.RIGS[0])
    assert found.camera_from_points is None
    result = _core.resect(
        points_in_world=none,
        observed_px=none,
        stereo=blunders.RIGS[0],
        camera_from_world=_core.Transform.from_matrix(np.eye(4)),
    )
    assert result.camera_from_world is None
    assert result.termination == _core.Termination.no_observations
    assert _core.judge(result=result, matches=0, median_depth_m=1.0) == _core.PoseQuality.lost


def test_p3p_sees_what_it_was_given() -> None:
    points = np.array([[-1.0, 0.2, 5.0], [1.5, -0.3, 6.0], [0.2, 1.0, 4.0]])
    poses = _core.solve_p3p(points=points, rays=points)
    identity = [np.abs(pose.matrix() - np.eye(4)).max() for pose in poses]
    assert min(identity) < 1e-9


def test_wrong_calls_are_refused(trial: blunders.Trial) -> None:
    with pytest.raises(ValueError, match="points in one picture"):
        _core.find_blunders(points_a=np.zeros((20, 2)), points_b=np.zeros((19, 2)))
    with pytest.raises(ValueError, match="not finite"):
        _core.find_blunders(points_a=np.full((20, 2), np.nan), points_b=np.zeros((20, 2)))
    with pytest.raises(ValueError, match="observations"):
        _core.resect_ransac(
            points_in_previous=np.zeros((5, 3)),
            observed_px=np.zeros((4, 3)),
            stereo=trial.stereo,
        )
    with pytest.raises(TypeError):
        _core.find_blunders(np.zeros((20, 2)), np.zeros((20, 2)))  # keywords only
    with pytest.raises(TypeError):
        _core.find_blunders(points_a=np.zeros((20, 3)), points_b=np.zeros((20, 3)))


def test_losses_weigh_as_documented() -> None:
    weight = _core.robust_weight
    danish = _core.RobustLoss.danish
    assert weight(loss=danish, normalised=3.0, iteration=1) == 1.0
    assert weight(loss=danish, normalised=4.0, iteration=3) == pytest.approx(np.exp(-0.05 * 4**4.4))
    assert weight(loss=danish, normalised=4.0, iteration=4) == pytest.approx(np.exp(-0.05 * 4**3))
    assert weight(loss=_core.RobustLoss.tukey, normalised=5.0) == 0.0
