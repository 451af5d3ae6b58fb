# SPDX-License-Identifier: Apache-2.0
"""Covariances of the estimation are those of the errors made: NEES inside its 99 % band."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

from consistency import Band, about_the_pose, measure


def test_nees_lies_in_its_band() -> None:
    bands = measure(runs=16, recordings=0, pairs=0)
    assert set(bands) == {"estimation, window", "estimation, whole path"}
    for name, band in bands.items():
        assert band.verdict == "inside", f"{name}: {band.mean} of {band.limits}"


def test_band_tells_wrong_covariances() -> None:
    honest = np.random.default_rng(0).chisquare(6, 400)
    assert Band(honest).verdict == "inside"
    assert Band(1.3 * honest).verdict == "too sure"
    assert Band(0.7 * honest).verdict == "too careful"


def test_covariance_is_moved_to_the_pose() -> None:
    """A rotation about the origin moves a pose that is away from it."""
    turn_only = np.diag([0, 0, 0, 0, 0, 1e-4])
    moved = about_the_pose(turn_only, np.array([2.0, 0, 0]))
    np.testing.assert_allclose(np.diag(moved), [0, 4e-4, 0, 0, 0, 1e-4], atol=1e-18)
    assert moved[1, 5] == pytest.approx(2e-4)
