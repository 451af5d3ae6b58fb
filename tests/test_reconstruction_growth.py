# SPDX-License-Identifier: Apache-2.0
"""The benchmark of growth in small, and its walk, whose first pairs fit two motions."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from test_benchmarks import BENCHMARKS

sys.path.insert(0, str(BENCHMARKS))

from reconstruction_growth import exponent, walk

from pilotage.behaviors.reconstruct import reconstruct
from pilotage.evaluation.camera_poses import pose_errors


def test_the_exponent_is_that_of_the_costs():
    counts = [62, 125, 250, 500]
    assert exponent(counts, [0.1 * n for n in counts]) == pytest.approx(1)
    assert exponent(counts, [n * np.log(n) for n in counts]) == pytest.approx(1.2, abs=0.02)
    assert np.isnan(exponent([62], [1.0]))


@pytest.mark.parametrize(("seed", "first", "count"), [(5, 0, 12), (5, 0, 18), (11, 44, 8)])
def test_the_wrong_motion_before_a_wall_begins_no_model(
    tmp_path: Path, seed: int, first: int, count: int
):
    pictures = walk(tmp_path, count, seed=seed, first=first)
    found = reconstruct(pictures.pictures, camera=pictures.camera)
    assert found.is_whole
    errors = pose_errors(estimate=found.model.world_from_camera(), truth=pictures.truth)
    assert errors is not None
    assert errors.ate_rmse_m < 0.005
    assert errors.rotation_max_deg < 0.1
