# SPDX-License-Identifier: Apache-2.0
"""Poses of the robot where the calibration says how the camera sits on it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from synthetic import SyntheticRecording
from typer.testing import CliRunner

from pilotage.calibration import load_rig
from pilotage.calibration.own import write_own
from pilotage.cli.main import app
from pilotage.recordings import open_recording
from pilotage.results import read_results

# x ahead, y left, z up at the wheels; the camera looks ahead.
ROBOT_FROM_LEFT = {"translation_m": [0.3, 0.05, 0.7], "quaternion_wxyz": [0.5, -0.5, 0.5, -0.5]}


def call(*arguments: object) -> Any:
    done = CliRunner().invoke(app, list(map(str, arguments)))
    assert done.exit_code == 0, done.output
    return done


def test_recording_to_evaluation(synthetic_kitti: SyntheticRecording, tmp_path: Path):
    rig = open_recording(synthetic_kitti.path).rig
    calibration = yaml.safe_load(write_own(rig))
    calibration["robot_from_left"] = ROBOT_FROM_LEFT
    given = tmp_path / "rig.yaml"
    given.write_text(yaml.safe_dump(calibration))
    assert load_rig(given).robot_from_left is not None
    camera_out, out = tmp_path / "camera", tmp_path / "robot"
    call("localize", synthetic_kitti.path, "-o", camera_out, "--no-report")
    call("localize", synthetic_kitti.path, "-o", out, "--calibration", given, "--no-report")
    results = read_results(out)
    assert results.summary["body"] == "robot"
    robot_m, camera_m = (
        results.records[-1].position_m,
        read_results(camera_out).records[-1].position_m,
    )
    assert robot_m is not None
    assert camera_m is not None
    assert robot_m[0] == pytest.approx(camera_m[2], abs=0.1)
    assert abs(robot_m[1]) < 1
    assert abs(robot_m[2]) < 0.5
    call("evaluate", out, "--truth", synthetic_kitti.path)
    assert json.loads((out / "evaluation.json").read_text())["ate_rmse_m"] < 0.02
