# SPDX-License-Identifier: Apache-2.0
"""The rigs of several stereo pairs: written, read, set against each other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from pilotage import Camera, StereoRig, Transform
from pilotage.calibration.files import load_rig, save_rig
from pilotage.calibration.rig_calibration import (
    RigCalibration,
    load_rigs,
    looks_down,
    save_rigs,
)
from pilotage.errors import InputError

AHEAD = [0.5, -0.5, 0.5, -0.5]
HALF = float(np.sqrt(0.5))
DOWN = [0.0, HALF, -HALF, 0.0]


def rig(place_m: tuple[float, float, float] | None, quaternion: list[float] = AHEAD) -> StereoRig:
    camera = Camera(width_px=160, height_px=120, fx_px=130, fy_px=131, cx_px=80.1, cy_px=60.3)
    sits = None
    if place_m is not None:
        sits = Transform(translation_m=list(place_m), quaternion_wxyz=quaternion)
    return StereoRig(
        left=camera,
        right=camera,
        right_from_left=Transform(translation_m=[-0.058, 0, 0]),
        robot_from_left=sits,
    )


def tilted_down(degrees: float) -> list[float]:
    """Return a camera that looks ahead, tilted so far towards the ground."""
    half = np.radians(-degrees) / 2
    ahead = Transform(quaternion_wxyz=AHEAD)
    tilt = Transform(quaternion_wxyz=[float(np.cos(half)), float(np.sin(half)), 0, 0])
    return list((ahead @ tilt).quaternion_wxyz.tolist())


FRONT, BELOW = rig((0.5, 0.03, 0.6)), rig((0.4, 0.03, 0.5), DOWN)


def test_rigs_come_back_exactly(tmp_path: Path):
    file = tmp_path / "rigs.yaml"
    save_rigs({"front": FRONT, "down": BELOW}, file)
    back = load_rigs(file)
    assert back is not None
    assert list(back) == ["front", "down"]
    for name, rig_before in (("front", FRONT), ("down", BELOW)):
        sits, sat = back[name].robot_from_left, rig_before.robot_from_left
        assert sits is not None
        assert sat is not None
        np.testing.assert_array_equal(sits.matrix(), sat.matrix())
        assert back[name].left.cx_px == rig_before.left.cx_px
    # A reader of a single rig gets the one that is asked for, else the first.
    np.testing.assert_allclose(load_rig(file).robot_from_left.matrix(), sits_of(FRONT))
    np.testing.assert_allclose(load_rig(file, pair="down").robot_from_left.matrix(), sits_of(BELOW))


def sits_of(one: StereoRig) -> np.ndarray:
    assert one.robot_from_left is not None
    return np.asarray(one.robot_from_left.matrix())


def test_where_one_pair_sits_against_another():
    rigs = RigCalibration({"front": FRONT, "down": BELOW})
    front_from_down = rigs.left_from_left("front", "down").matrix()
    expected = np.linalg.inv(sits_of(FRONT)) @ sits_of(BELOW)
    np.testing.assert_allclose(front_from_down, expected, atol=1e-12)
    # 10 cm behind and 10 cm below the forward camera: z is ahead, y is down.
    np.testing.assert_allclose(front_from_down[:3, 3], [0, 0.1, -0.1], atol=1e-12)
    back = rigs.left_from_left("down", "front").matrix()
    np.testing.assert_allclose(back @ front_from_down, np.eye(4), atol=1e-12)


def test_a_missing_pair_is_named(tmp_path: Path):
    rigs = RigCalibration({"front": FRONT, "left": rig(None)}, "rigs.yaml")
    with pytest.raises(InputError, match=r"rigs\.yaml: has no pair 'down'; there are: front, left"):
        rigs.left_from_left("front", "down")
    with pytest.raises(InputError, match=r"'forward'.*did you mean"):
        RigCalibration({"forwards": FRONT}, "x")["forward"]
    with pytest.raises(InputError, match=r"rigs\.yaml: pair 'left' .* robot_from_left"):
        rigs.left_from_left("left", "front")
    file = tmp_path / "rigs.yaml"
    save_rigs({"front": FRONT}, file)
    with pytest.raises(InputError, match="has no pair 'down'"):
        load_rig(file, pair="down")


def test_faults_of_a_pair_name_it(tmp_path: Path):
    file = tmp_path / "rigs.yaml"
    save_rigs({"front": FRONT, "down": BELOW}, file)
    document = yaml.safe_load(file.read_text())
    document["pairs"]["down"]["left"]["fx_px"] = "wide"
    file.write_text(yaml.safe_dump(document))
    with pytest.raises(InputError, match=r"pairs\.down\.left\.fx_px"):
        load_rigs(file)
    file.write_text("pairs: {}\n")
    with pytest.raises(InputError, match="names no pair"):
        load_rigs(file)
    save_rig(FRONT, file)
    assert load_rigs(file) is None


@pytest.mark.parametrize(("degrees", "down"), [(0, False), (50, False), (60, True), (90, True)])
def test_what_looks_down_is_told_by_where_it_sits(degrees: float, down: bool):
    sits = rig((0.5, 0, 0.6), tilted_down(degrees))
    assert looks_down("front", sits) == down
    assert looks_down("down", sits) == down


@pytest.mark.parametrize(
    ("name", "down"),
    [
        ("down", True),
        ("robot/downward", True),
        ("nadir_cam", True),
        ("Ground", True),
        ("front", False),
        ("background", False),
    ],
)
def test_else_by_its_name(name: str, down: bool):
    assert looks_down(name, rig(None)) == down
