# SPDX-License-Identifier: Apache-2.0
"""Recordings of several stereo pairs: joined, judged, and told of, through the program."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from pair_recordings import rewritten
from program import call, said, summary_of

from pilotage.behaviors.choice import Choice, choose
from pilotage.behaviors.localize_joint import localize_joint
from pilotage.config import UserConfig
from pilotage.evaluation.report import draw_report
from pilotage.judge_files import read_judge_table
from pilotage.pose_files import PoseRecord, read_pose_table
from pilotage.results import FILES, JUDGE_FILES, REPORT, read_results


def test_all_pairs_are_joined_by_default(joined_pairs: Path):
    summary = summary_of(joined_pairs)
    assert [pair["name"] for pair in summary["stereo_pairs"]] == ["front", "down"]
    assert [pair["looks"] for pair in summary["stereo_pairs"]] == ["ahead", "down"]
    assert summary["judge"]["use"] == "joint"
    assert summary["judge"]["rule"] == "chi_square"
    assert summary["judge"]["stops"] == 0
    assert summary["tracked"] + summary["degraded"] == summary["pairs"] > 40
    assert {file.name for file in joined_pairs.iterdir()} == {*FILES, *JUDGE_FILES, "pairs"}
    for name in ("front", "down"):
        files = {file.name for file in (joined_pairs / "pairs" / name).iterdir()}
        assert {"poses.csv", "poses_live.csv", "trajectory_tum.txt", "calibration.yaml"} <= files
        assert (
            len(read_pose_table(joined_pairs / "pairs" / name / "poses.csv"))
            >= summary["pairs"] - 2
        )


def test_the_judges_table_shows_each_pair_at_each_instant(joined_pairs: Path):
    rows = read_judge_table(joined_pairs / "judge.csv")
    assert len(rows) == 2 * summary_of(joined_pairs)["pairs"]
    front, down = rows[0::2], rows[1::2]
    assert {row.pair for row in front} == {"front"}
    assert all(row.lever_m == (0, 0, 0) for row in front)
    np.testing.assert_allclose([row.lever_m for row in down], [(-0.01, 0.0, -0.1)] * len(down))
    compared = np.array([row.difference for row in down if np.isfinite(row.chi_square)])
    assert len(compared) > 30
    assert np.median(np.abs(compared[:, :3])) < 0.005
    for row in rows:
        assert (row.pair in row.believed) == (row.belief == "joined")


def test_evaluate_prints_each_pair_beside_the_joint(joined_pairs: Path):
    done = call("evaluate", joined_pairs, "--no-report")
    assert done.exit_code == 0, done.output
    assert "joined, and each stereo pair alone" in said(done)
    evaluation = json.loads((joined_pairs / "evaluation.json").read_text())
    alone = evaluation["stereo_pairs"]
    assert set(alone) == {"front", "down"}
    ends = [alone[name]["end_error_percent"] for name in alone]
    assert evaluation["end_error_percent"] < 1.1 * min(ends) + 0.02
    assert evaluation["truth_length_m"] == pytest.approx(3.08, abs=0.1)


def test_the_report_shows_all_pairs(joined_pairs: Path):
    page = (joined_pairs / REPORT).read_text()
    for words in ("Which camera is believed", "What joining gave", "left cameras saw"):
        assert words in page
    assert page.count("<svg") == 7 + 1 + 3


def test_results_do_not_depend_on_the_threads(yard_pairs: Path, joined_pairs: Path, tmp_path: Path):
    out = tmp_path / "again"
    assert call("localize", yard_pairs, "-o", out, "--no-report").exit_code == 0
    names = ["poses.csv", "poses_live.csv", "judge.csv", "judge_live.csv", "points.ply"]
    for name in [*names, "pairs/front/poses.csv", "pairs/down/poses_live.csv"]:
        assert (out / name).read_bytes() == (joined_pairs / name).read_bytes(), name


def test_config_and_calibration_of_a_run_can_be_given_to_the_next(
    yard_pairs: Path, joined_pairs: Path, tmp_path: Path
):
    out = tmp_path / "out"
    given = [
        "--config",
        joined_pairs / "config.yaml",
        "--calibration",
        joined_pairs / "calibration.yaml",
    ]
    done = call("localize", yard_pairs, "-o", out, "--no-report", *given)
    assert done.exit_code == 0, done.output
    for name in ("judge.csv", "config.yaml", "calibration.yaml"):
        assert (out / name).read_bytes() == (joined_pairs / name).read_bytes()


def test_one_pair_is_tracked_as_it_looks(yard_pairs: Path, tmp_path: Path):
    for use, front_end in (("forward", "patch"), ("down", "grid")):
        out = tmp_path / use
        assert call("localize", yard_pairs, "--use", use, "-o", out, "--no-report").exit_code == 0
        assert yaml.safe_load((out / "config.yaml").read_text())["front_end"] == front_end
        assert not (out / "pairs").exists()
        assert "judge" not in summary_of(out)


def test_the_papers_choice(yard_pairs: Path, tmp_path: Path):
    out = tmp_path / "out"
    assert call("localize", yard_pairs, "--use", "paper", "-o", out, "--no-report").exit_code == 0
    rows = read_judge_table(out / "judge.csv")
    assert all(len(row.believed) == 1 for row in rows)
    assert summary_of(out)["judge"]["rule"] == "paper"


def test_any_number_of_pairs(yard_pairs: Path, tmp_path: Path):
    names = [("front", "front"), ("down", "down"), ("down", "below")]
    file = rewritten(yard_pairs, tmp_path / "three.mcap", names=names)
    out = tmp_path / "out"
    done = call("localize", file, "-o", out, "--end", "12")
    assert done.exit_code == 0, done.output
    summary = summary_of(out)
    assert [pair["name"] for pair in summary["stereo_pairs"]] == ["front", "below", "down"]
    # `below` says where it sits, so its name does not matter.
    assert [pair["looks"] for pair in summary["stereo_pairs"]] == ["ahead", "down", "down"]
    assert "front+below+down" in summary["judge"]["believed"]
    assert (out / REPORT).exists()


def test_clocks_that_differ_are_found_and_corrected(
    yard_pairs: Path, joined_pairs: Path, tmp_path: Path
):
    file = rewritten(yard_pairs, tmp_path / "late.mcap", shift_ns={"down": 160_000_000})
    out = tmp_path / "out"
    done = call("localize", file, "-o", out, "--no-report")
    assert done.exit_code == 0, done.output
    (clock,) = summary_of(out)["clocks"]
    assert clock["late_ms"] == pytest.approx(160, abs=25)
    assert clock["corrected_ms"] == clock["late_ms"]
    assert "of down are" in said(done)
    assert "late against front's, steadily. They were corrected" in said(done)
    before, after = (summary_of(of)["judge"]["believed"] for of in (joined_pairs, out))
    assert after.get("front+down", 0) > 0.6 * before["front+down"]


def test_clocks_that_drift_apart_are_told(yard_pairs: Path, tmp_path: Path):
    file = rewritten(yard_pairs, tmp_path / "drift.mcap", drift={"down": 0.05})
    done = call("localize", file, "-o", tmp_path / "out", "--no-report")
    assert done.exit_code == 0, done.output
    (clock,) = summary_of(tmp_path / "out")["clocks"]
    assert clock["drift_ms_per_min"] == pytest.approx(3000, rel=0.35)
    assert "ms a minute" in said(done)


def chosen(yard_pairs: Path) -> Choice:
    return choose(yard_pairs, config=UserConfig())


class Breaking:
    """A recording that breaks in the middle."""

    def __init__(self, recording: Any) -> None:
        self._recording = recording

    def __getattr__(self, name: str) -> Any:
        return getattr(self._recording, name)

    def __len__(self) -> int:
        return len(self._recording)

    def frames(self) -> Iterator[Any]:
        for frame in self._recording.frames():
            if frame.index == 20:
                raise OSError("the disk is gone")
            yield frame


def test_a_fault_of_one_pair_ends_that_pair_alone(yard_pairs: Path, tmp_path: Path):
    choice = chosen(yard_pairs)
    object.__setattr__(choice.sources[1], "recording", Breaking(choice.sources[1].recording))
    summary = localize_joint(choice=choice, judge=UserConfig().judge(), out=tmp_path / "out")
    assert summary["state"] == "finished"
    assert summary["lost"] == 0
    assert summary["pairs"] > 40
    assert any("down failed after 20 pictures: the disk is gone" in w for w in summary["warnings"])
    last = read_judge_table(tmp_path / "out" / "judge.csv")[-1]
    assert (last.pair, last.belief, last.believed) == ("down", "absent", ("front",))


def test_an_error_of_all_goes_on_with_everything_written(yard_pairs: Path, tmp_path: Path):
    choice = chosen(yard_pairs)
    for source in choice.sources:
        object.__setattr__(source, "recording", Breaking(source.recording))
    with pytest.raises(OSError, match="disk is gone"):
        localize_joint(choice=choice, judge=UserConfig().judge(), out=tmp_path / "out")
    assert summary_of(tmp_path / "out")["state"] == "failed"
    assert len(read_pose_table(tmp_path / "out" / "poses.csv")) == 20


def test_an_error_of_the_run_itself_keeps_what_was_computed(yard_pairs: Path, tmp_path: Path):
    def break_down(done: int, record: PoseRecord, words: str) -> None:
        if done >= 15:
            raise RuntimeError("the screen is gone")

    with pytest.raises(RuntimeError, match="screen"):
        localize_joint(
            choice=chosen(yard_pairs),
            judge=UserConfig().judge(),
            out=tmp_path / "out",
            on_instant=break_down,
        )
    summary = summary_of(tmp_path / "out")
    assert (summary["state"], summary["error"]) == ("failed", "the screen is gone")
    assert 14 <= len(read_pose_table(tmp_path / "out" / "poses.csv")) < 40


def test_an_interrupt_keeps_what_was_computed(yard_pairs: Path, tmp_path: Path):
    def stop(done: int, record: PoseRecord, words: str) -> None:
        assert "using" in words
        if done >= 15:
            raise KeyboardInterrupt

    summary = localize_joint(
        choice=chosen(yard_pairs), judge=UserConfig().judge(), out=tmp_path / "out", on_instant=stop
    )
    assert summary["state"] == "interrupted"
    assert 14 <= summary["pairs"] < 40
    assert len(read_results(tmp_path / "out").records) == summary["pairs"]


def test_a_killed_run_can_be_drawn(yard_pairs: Path, tmp_path: Path):
    out = tmp_path / "out"
    assert call("localize", yard_pairs, "-o", out, "--no-report", "--end", "20").exit_code == 0
    for name in ("poses.csv", "judge.csv", "pairs/front/poses.csv", "pairs/down/poses.csv"):
        (out / name).unlink()
    (out / "summary.json").write_text('{"program": "pilotage", "state": "running"}')
    draw_report(out)
    assert "Which camera is believed" in (out / REPORT).read_text()


def test_an_earlier_run_of_several_is_replaced(yard_pairs: Path, tmp_path: Path):
    out = tmp_path / "out"
    few = ["--no-report", "--end", "4", "--overwrite"]
    assert call("localize", yard_pairs, "-o", out, *few).exit_code == 0
    (out / "pairs" / "front" / "notes.txt").write_text("mine")
    assert call("localize", yard_pairs, "--pair", "front", "-o", out, *few).exit_code == 0
    assert not (out / "judge.csv").exists()
    assert [file.name for file in (out / "pairs").rglob("*.*")] == ["notes.txt"]
