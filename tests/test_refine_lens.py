# SPDX-License-Identifier: Apache-2.0
"""A calibration that is a little wrong: what it left of the lens is found, poses get better."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from program import call, said, summary_of
from rendering import room
from test_other_cameras import CENTRE, FOCAL, HEIGHT, WIDTH, photograph
from test_reconstruct import pose

from pilotage import Camera, ReconstructionConfig
from pilotage.behaviors.reconstruct import focal_fault, solve
from pilotage.calibration.one_camera import load_camera
from pilotage.calibration.own import camera_values
from pilotage.evaluation.camera_poses import pose_errors

RADIAL = 0.02  # of the camera, which its calibration does not know
HELD = ReconstructionConfig.from_dict({"lens_sigma": 0})


def calibrated(**changes: object) -> Camera:
    """Return the camera as it is thought to be."""
    known = {
        "width_px": WIDTH, "height_px": HEIGHT, "fx_px": FOCAL, "fy_px": FOCAL,
        "cx_px": CENTRE[0], "cy_px": CENTRE[1],
    }  # fmt: skip
    return Camera(**{**known, **changes})


def bent(picture: np.ndarray) -> np.ndarray:
    """Return what a lens with that distortion makes of a picture."""
    matrix = np.array([[FOCAL, 0, CENTRE[0]], [0, FOCAL, CENTRE[1]], [0, 0, 1]])
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    pixels = np.stack([x, y], axis=-1).reshape(-1, 1, 2)
    lens = np.array([RADIAL, 0, 0, 0])
    ideal = cv2.undistortPoints(pixels, matrix, lens, P=matrix).reshape(HEIGHT, WIDTH, 2)
    return cv2.remap(picture, ideal, None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    """A walk of 2.4 m along an arc, with the eyes on what is inside it."""
    steps = np.linspace(-1, 1, 12)
    return np.array([pose(0.5 * t * t, -1.2 * t, 25 * t) for t in steps])


@pytest.fixture(scope="module")
def pictures(truth) -> list[np.ndarray]:
    return [bent(picture) for picture in photograph(room(3.0, np.random.default_rng(3)), truth)]


def test_a_distortion_that_was_left_is_found_and_poses_get_better(pictures, truth):
    names = [str(i) for i in range(len(pictures))]
    found = solve(pictures, names, camera=calibrated())
    held = solve(pictures, names, camera=calibrated(), config=HELD)
    assert found.is_whole
    assert focal_fault(found) is None
    assert held.result.radial == 0
    assert held.camera.distortion == "none"
    assert found.camera.distortion == "brown"
    assert found.camera.fx_px == found.camera.fy_px == found.result.focal_px
    assert abs(found.result.focal_px / FOCAL - 1) < 0.005
    assert abs(found.result.radial - RADIAL) < 0.005
    # The model's own camera is the one that its points were adjusted with.
    assert np.nanmedian(found.model.reprojection_errors_px()) < 0.1
    better, worse = (
        pose_errors(estimate=model.world_from_camera(), truth=truth)
        for model in (found.model, held.model)
    )
    assert better.ate_rmse_m < 0.3 * worse.ate_rmse_m
    assert better.rotation_median_deg < 0.3 * worse.rotation_median_deg


def test_a_lens_that_is_known_is_taken_as_it_is(pictures):
    camera = calibrated(distortion="brown", coefficients=[RADIAL, 0, 0, 0])
    names = [str(i) for i in range(len(pictures))]
    found = solve(pictures, names, camera=camera)
    assert found.result.radial == 0
    assert found.camera == camera


def test_the_program_says_that_a_calibration_is_wrong(pictures, tmp_path: Path):
    folder, out = tmp_path / "pictures", tmp_path / "out"
    folder.mkdir()
    for i, picture in enumerate(pictures):
        cv2.imwrite(str(folder / f"{i:02d}.png"), picture)
    known = yaml.safe_dump(camera_values(calibrated()), sort_keys=False)
    (folder / "calibration.yaml").write_text(known)
    result = call("reconstruct", folder, "-o", out)
    assert result.exit_code == 0, said(result)
    assert "which their calibration does not know" in said(result)
    summary = summary_of(out)
    assert "px in their corners" in summary["lens_fault"]
    assert abs(summary["focal_px"] / FOCAL - 1) < 0.005
    assert load_camera(out).distortion == "brown"
