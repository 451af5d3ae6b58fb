# SPDX-License-Identifier: Apache-2.0
"""The focal length that pictures tell: near the truth, with an error that is right, or unsure."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from program import call, said, summary_of
from rendering import room
from test_other_cameras import CENTRE, FOCAL, HEIGHT, WIDTH, photograph
from test_reconstruct import pose

from pilotage import Camera, ReconstructionConfig
from pilotage.behaviors.reconstruct import (
    NOMINAL_FOCAL_SIGMA,
    USABLE_FOCAL_SIGMA,
    Reconstructed,
    solve,
)

CONFIG = ReconstructionConfig.from_dict({"focal_sigma": NOMINAL_FOCAL_SIGMA})


def fov_deg(focal_px: float) -> float:
    return float(np.degrees(2 * np.arctan(0.5 * WIDTH / focal_px)))


def refined(pictures: list[np.ndarray], focal_px: float) -> Reconstructed:
    """Reconstruct with a focal length to begin with."""
    camera = Camera(
        width_px=WIDTH, height_px=HEIGHT, fx_px=focal_px, fy_px=focal_px,
        cx_px=CENTRE[0], cy_px=CENTRE[1],
    )  # fmt: skip
    names = [str(i) for i in range(len(pictures))]
    return solve(pictures, names, camera=camera, config=CONFIG)


@pytest.fixture(scope="module")
def turning() -> list[np.ndarray]:
    """A walk of 2.4 m along an arc, with the eyes on what is inside it."""
    steps = np.linspace(-1, 1, 12)
    poses = [pose(0.5 * t * t, -1.2 * t, 25 * t) for t in steps]
    return photograph(room(3.0, np.random.default_rng(3)), np.array(poses))


@pytest.mark.parametrize("wrong", [0.85, 1.15, 1.25])
def test_a_wrong_focal_length_is_put_right(turning, wrong):
    found = refined(turning, wrong * FOCAL)
    assert found.is_whole
    focal, sigma = found.result.focal_px, found.result.focal_sigma_px
    assert abs(focal / FOCAL - 1) < 0.01
    assert 0 < sigma < USABLE_FOCAL_SIGMA * FOCAL
    assert abs(focal - FOCAL) < 3 * sigma
    assert found.camera.fx_px == found.camera.fy_px == focal
    errors_px = found.model.reprojection_errors_px()
    assert np.nanmedian(errors_px) < 0.3


def test_a_step_straight_ahead_hardly_tells_and_says_so(tmp_path: Path):
    poses = [pose(0.04 * k, 0.0, 0.0) for k in range(4)]
    pictures = photograph(room(3.0, np.random.default_rng(3)), np.array(poses))
    for i, picture in enumerate(pictures):
        (tmp_path / "pictures").mkdir(exist_ok=True)
        cv2.imwrite(str(tmp_path / "pictures" / f"{i}.png"), picture)
    done = call(
        "reconstruct", tmp_path / "pictures", "-o", tmp_path / "out", "--no-report",
        "--fov-deg", fov_deg(1.15 * FOCAL), "--refine-fov", "--set", "min_angle_deg=0.1",
    )  # fmt: skip
    summary = summary_of(tmp_path / "out")
    if summary["posed"] == 0:
        assert done.exit_code == 1
        return
    if abs(summary["focal_px"] / FOCAL - 1) > USABLE_FOCAL_SIGMA:
        assert summary["verdict"].startswith("unsure")
        assert "calibrate" in said(done)


def test_the_found_camera_is_written_and_told(turning, tmp_path: Path):
    folder = tmp_path / "pictures"
    folder.mkdir()
    for i, picture in enumerate(turning):
        cv2.imwrite(str(folder / f"{i:02}.png"), picture)
    where = ("-o", tmp_path / "out", "--no-report")
    done = call("reconstruct", folder, *where, "--fov-deg", fov_deg(0.9 * FOCAL), "--refine-fov")
    assert done.exit_code == 0, done.output
    summary = summary_of(tmp_path / "out")
    assert summary["verdict"] == "whole"
    assert abs(summary["fov_deg"] - fov_deg(FOCAL)) < 0.5
    assert "focal length" in said(done)
    calibration = (tmp_path / "out" / "calibration.yaml").read_text()
    assert str(round(summary["focal_px"], 3))[:6] in calibration


def test_only_a_nominal_view_is_refined(turning, tmp_path: Path):
    folder = tmp_path / "pictures"
    folder.mkdir()
    cv2.imwrite(str(folder / "0.png"), turning[0])
    (tmp_path / "camera.yaml").write_text(
        f"width_px: {WIDTH}\nheight_px: {HEIGHT}\nfx_px: 420\nfy_px: 420\ncx_px: 240\ncy_px: 180\n"
    )
    calibration = ("--calibration", tmp_path / "camera.yaml")
    for extra in (("--refine-fov",), ("--set", "focal_sigma=0.2")):
        done = call("reconstruct", folder, "-o", tmp_path / "out", *calibration, *extra)
        assert done.exit_code == 2
        assert "give --fov-deg" in said(done)


def test_the_core_refuses_a_lens_with_a_free_focal_length(turning):
    camera = Camera(
        width_px=WIDTH, height_px=HEIGHT, fx_px=FOCAL, fy_px=FOCAL, cx_px=CENTRE[0],
        cy_px=CENTRE[1], distortion="brown", coefficients=[0.1, 0, 0, 0, 0],
    )  # fmt: skip
    with pytest.raises(ValueError, match="without distortion"):
        solve(turning[:2], ["0", "1"], camera=camera, config=CONFIG)
