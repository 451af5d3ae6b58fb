# SPDX-License-Identifier: Apache-2.0
"""Stereo pairs that cannot be used, and calls that cannot be: named, and the job goes on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from pair_recordings import rewritten
from program import call, said, summary_of

from pilotage import StereoRig, Transform
from pilotage.behaviors.choice import choose
from pilotage.config import UserConfig
from pilotage.errors import InputError
from pilotage.recordings import open_recording


@pytest.mark.parametrize(
    ("dropped", "why"),
    [
        (["/down_left/camera_info"], "has no /down_left/camera_info"),
        (["/down_right/image"], "holds no picture of /down_right"),
        (["/down_left/image", "/down_right/image"], "no picture of /down_left and /down_right"),
    ],
)
def test_a_pair_that_cannot_be_used_is_left_out(
    yard_pairs: Path, tmp_path: Path, dropped: list[str], why: str
):
    file = rewritten(yard_pairs, tmp_path / "spoilt.mcap", dropped=dropped)
    done = call("localize", file, "-o", tmp_path / "out", "--no-report", "--end", "8")
    assert done.exit_code == 0, done.output
    assert "The stereo pair down is left out" in said(done)
    assert why in said(done), said(done)
    assert "Going on with front" in said(done)
    assert any("left out" in warning for warning in summary_of(tmp_path / "out")["warnings"])


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"right_from_left": {"translation_m": [0.058, 0, 0]}}, "lies left of the left one"),
        (
            {"right_from_left": {"quaternion_wxyz": [0.7071068, 0, 0.7071068, 0]}},
            "only side-by-side pairs",
        ),
        ({"right_from_left": {"quaternion_wxyz": [0.7660444, 0.6427876, 0, 0]}}, "share less than"),
        ({"left": {"width_px": 200}, "right": {"width_px": 200}}, "the calibration is for 200x180"),
        (None, "has no pair 'down'"),
    ],
)
def test_a_pair_whose_calibration_cannot_be_is_left_out(
    yard_pairs: Path, joined_pairs: Path, tmp_path: Path, change: dict[str, Any] | None, why: str
):
    document = yaml.safe_load((joined_pairs / "calibration.yaml").read_text())
    if change is None:
        del document["pairs"]["down"]
    for key, values in (change or {}).items():
        document["pairs"]["down"][key] |= values
    given = tmp_path / "rigs.yaml"
    given.write_text(yaml.safe_dump(document))
    out = tmp_path / "out"
    done = call(
        "localize", yard_pairs, "--calibration", given, "-o", out, "--no-report", "--end", "8"
    )
    assert done.exit_code == 0, done.output
    assert "The stereo pair down is left out" in said(done)
    assert why in said(done), said(done)


def test_cameras_exchanged_in_the_recording_itself(yard_pairs: Path, tmp_path: Path):
    wrong = {("down_left", "down_right"): Transform(translation_m=[-0.058, 0, 0])}
    file = rewritten(yard_pairs, tmp_path / "exchanged.mcap", statics=wrong)
    done = call("localize", file, "-o", tmp_path / "out", "--no-report", "--end", "8")
    assert done.exit_code == 0, done.output
    assert "The stereo pair down is left out" in said(done)
    assert "lies left of the left one" in said(done)


def test_a_pair_that_does_not_say_where_it_sits(yard_pairs: Path, tmp_path: Path):
    rig = open_recording(yard_pairs, pair="down").rig
    bare = StereoRig(left=rig.left, right=rig.right, right_from_left=rig.right_from_left)
    file = rewritten(yard_pairs, tmp_path / "bare.mcap", rigs={"down": bare})
    few = ["--no-report", "--end", "8"]
    done = call("localize", file, "-o", tmp_path / "ahead", *few)
    assert done.exit_code == 0, done.output
    assert "judge" not in summary_of(tmp_path / "ahead")
    done = call("localize", file, "-o", tmp_path / "joint", "--use", "joint", *few)
    assert "The stereo pair down is left out: nothing says where it sits" in said(done)
    # Its name tells that it looks down.
    done = call("localize", file, "-o", tmp_path / "down", "--use", "down", *few)
    assert done.exit_code == 0, done.output
    used = yaml.safe_load((tmp_path / "down" / "config.yaml").read_text())
    assert used["front_end"] == "grid"


def test_without_a_sound_pair_nothing_is_done(yard_pairs: Path, tmp_path: Path):
    file = rewritten(yard_pairs, tmp_path / "none.mcap", dropped=["_left/camera_info"])
    done = call("localize", file, "-o", tmp_path / "out")
    assert done.exit_code == 2
    assert "no pair can be used: front:" in said(done)
    assert "has no /down_left/camera_info" in said(done)


def test_calls_that_cannot_be(yard_pairs: Path, joined_pairs: Path, tmp_path: Path):
    one = joined_pairs / "pairs" / "front" / "calibration.yaml"
    for arguments, why in (
        (["--pair", "front", "--use", "down"], "give one of them"),
        (["--use", "joint", "--calibration", one], "is of one stereo pair"),
        (["--set", "pairs.dwon.points=200"], "did you mean down?"),
    ):
        done = call("localize", yard_pairs, "-o", tmp_path / "out", *arguments)
        assert done.exit_code == 2, done.output
        assert why in said(done), said(done)
    alone = rewritten(yard_pairs, tmp_path / "one.mcap", names=[("front", "front")])
    for use, why in (("joint", "holds one stereo pair"), ("paper", "holds one stereo pair")):
        done = call("localize", alone, "-o", tmp_path / "out", "--use", use)
        assert done.exit_code == 2
        assert why in said(done), said(done)
    with pytest.raises(InputError, match="no stereo pair 'up'"):
        choose(yard_pairs, config=UserConfig(), pair="up")


def test_the_calibration_of_one_pair_is_for_the_one_that_looks_ahead(
    yard_pairs: Path, joined_pairs: Path, tmp_path: Path
):
    given = joined_pairs / "pairs" / "front" / "calibration.yaml"
    out = tmp_path / "out"
    done = call(
        "localize", yard_pairs, "--calibration", given, "-o", out, "--no-report", "--end", 5
    )
    assert done.exit_code == 0, done.output
    assert "judge" not in summary_of(out)
