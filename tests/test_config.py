# SPDX-License-Identifier: Apache-2.0
"""Configuration of several stereo pairs and of the judge."""

from __future__ import annotations

from pathlib import Path

import pytest

from pilotage import OdometryConfig
from pilotage.config import UserConfig, load_config
from pilotage.errors import InputError


def write(folder: Path, text: str) -> Path:
    file = folder / "mine.yaml"
    file.write_text(text)
    return file


def test_defaults_and_what_looking_down_changes():
    config = UserConfig()
    assert config.odometry("front").to_dict() == OdometryConfig().to_dict()
    down = config.odometry("down", is_downward=True).to_dict()
    changed = {key for key, value in OdometryConfig().to_dict().items() if down[key] != value}
    assert changed == {"front_end", "right_x_offset_prior_px"}
    assert down["front_end"] == "grid"


def test_sections_of_a_pair_and_of_the_judge(tmp_path: Path):
    text = "points: 300\npairs:\n  down: {points: 200, front_end: patch}\njudge: {window_s: 2}\n"
    config = load_config(write(tmp_path, text), ["pairs.front.seed=7", "judge.rejoin_s=3"])
    assert config.odometry("front").to_dict()["points"] == 300
    assert config.odometry("front").to_dict()["seed"] == 7
    down = config.odometry("down", is_downward=True).to_dict()
    # What the user says beats what suits a pair that looks down.
    assert (down["points"], down["front_end"], down["right_x_offset_prior_px"]) == (200, "patch", 0)
    assert config.odometry().to_dict()["points"] == 300
    judge = config.judge(rule="paper").to_dict()
    assert (judge["rule"], judge["window_s"], judge["rejoin_s"]) == ("paper", 2, 3)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("pionts: 3", r"mine\.yaml: unknown key pionts; did you mean points\?"),
        ("pairs: {down: {pionts: 3}}", r"pairs\.down\.pionts; did you mean points\?"),
        ("judge: {windows_s: 3}", r"judge\.windows_s; did you mean window_s\?"),
        ("jugde: {window_s: 3}", r"unknown key jugde; did you mean judge\?"),
        ("pairs: {down: {points: 3}}", r"mine\.yaml: pairs\.down\.points = 3"),
        ("judge: {rule: vote}", r"judge\.rule = vote.*chi_square"),
        ("pairs: 3", "pairs = 3: must be a mapping"),
        ("pairs: {down: 3}", r"pairs\.down = 3"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, text: str, said: str):
    with pytest.raises(InputError, match=said):
        load_config(write(tmp_path, text))


def test_a_pair_that_is_not_there_is_named_with_the_nearest(tmp_path: Path):
    config = load_config(write(tmp_path, "pairs: {dwon: {points: 200}}"))
    with pytest.raises(InputError, match=r"mine\.yaml: pairs\.dwon: .* did you mean down\?"):
        config.check_pairs(["front", "down"])
    load_config(write(tmp_path, "pairs: {down: {points: 200}}")).check_pairs(["front", "down"])
