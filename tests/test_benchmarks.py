# SPDX-License-Identifier: Apache-2.0
# Long: a test or two of each benchmark.
"""The benchmarks in small: they run, their figures are sane, their judgement is right."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from synthetic import SyntheticRecording

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"
sys.path.insert(0, str(BENCHMARKS))

from judge import Goal, judge  # noqa: E402
from memory import slope_kb_per_pair, there_and_back  # noqa: E402
from odometry import costs, goal_rows, with_ratio  # noqa: E402
from tables import markdown_table, number  # noqa: E402


def run_benchmark(script: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(BENCHMARKS / script), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def a_run(poses: np.ndarray, covariance: np.ndarray | None = None) -> dict[str, Any]:
    count = len(poses)
    covariances = np.full((count, 6, 6), np.nan)
    if covariance is not None:
        covariances[:] = covariance
    lost = ~np.isfinite(poses).all(axis=(1, 2))
    status = np.where(lost, "lost", "tracking")
    columns = {"poses": poses, "covariances": covariances, "status": status}
    columns["segment"] = np.zeros(count, int)
    run = {f"{when}_{key}": value for when in ("live", "final") for key, value in columns.items()}
    return {**run, "check": np.array("{}")}


def straight_path(count: int, step_m: float) -> np.ndarray:
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, 2, 3] = step_m * np.arange(count)
    return poses


@pytest.mark.parametrize("layout", ["synthetic_kitti", "synthetic_euroc"])
def test_odometry_compares_both_systems(
    layout: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    recording: SyntheticRecording = request.getfixturevalue(layout)
    out = tmp_path / "figures.json"
    done = run_benchmark("odometry.py", recording.path, "--limit", 8, "--repeats", 1, "--json", out)
    assert done.returncode == 0, done.stderr
    rows = json.loads(out.read_text())["runs"]
    assert [row["system"] for row in rows] == ["pilotage-patch", "opencv"]
    way_m = float(np.linalg.norm(recording.world_from_left[7, :3, 3]))
    for row in rows:
        assert row["pairs"] == 8
        assert row["lost"] == 0
        assert row["ate_m"] < 0.02 * way_m
        assert row["cpu_ms"] > 0
        assert row["peak_mb"] > 10
    assert "OpenCV/this" in done.stdout
    assert "| opencv" in done.stdout


def test_odometry_refuses_what_is_no_recording(tmp_path: Path) -> None:
    done = run_benchmark("odometry.py", tmp_path)
    assert done.returncode == 2
    assert str(tmp_path) in done.stderr


def test_memory_reports_and_judges(synthetic_kitti: SyntheticRecording) -> None:
    done = run_benchmark(
        "memory.py", synthetic_kitti.path, "--pairs", 30, "--report-every", 10, "--system", "opencv"
    )
    assert done.returncode in (0, 1), done.stderr
    assert [line.split()[0] for line in done.stdout.splitlines()[:3]] == ["10", "20", "30"]
    assert "kB a pair; peak" in done.stdout.splitlines()[-1]


def test_runs_write_identical_bytes(synthetic_kitti: SyntheticRecording) -> None:
    done = run_benchmark("determinism.py", synthetic_kitti.path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "identical bytes" in done.stdout


def test_every_recording_runs_and_judges(
    synthetic_kitti: SyntheticRecording, tmp_path: Path
) -> None:
    (tmp_path / "street").symlink_to(synthetic_kitti.path)
    (tmp_path / "textures").mkdir()
    table = tmp_path / "table.md"
    done = run_benchmark("every_recording.py", tmp_path, "--markdown", table)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "| street" in table.read_text()
    assert "- `textures`: not run" in table.read_text()


def test_moving_centres_beat_fixed_homographies(tmp_path: Path) -> None:
    out = tmp_path / "figures.json"
    done = run_benchmark(
        "head_sweep.py", "--seeds", 1, "--width", 320, "--distances", 1, 2, "--json", out
    )
    assert done.returncode in (0, 1), done.stderr
    assert ("MISS" in done.stdout) == (done.returncode == 1)
    for figure in json.loads(out.read_text())["alone"]:
        assert figure["features"] > 300
        assert figure["off-line"]["deg"] > 4 * figure["moving"]["deg"]
        assert figure["off-line"]["deg"] > 8 * figure["moving"]["measured"]["deg"]
        assert figure["crouched"]["share"] > 2 * figure["moving"]["share"]


def test_drives_go_on_where_they_were_interrupted(tmp_path: Path) -> None:
    out = tmp_path / "drives.jsonl"
    few = ["--width", 160, "--rate-hz", 5, "--longest-m", 5.1, "--workers", 1, "--out", out]
    first = run_benchmark("drives.py", "--drives", 1, *few)
    assert first.returncode == 0, first.stdout + first.stderr
    with out.open("a") as file:
        file.write('{"number": 1, "end_m": 0.0')  # cut off
    both = run_benchmark("drives.py", "--drives", 2, *few)
    assert both.returncode == 0, both.stdout + both.stderr
    assert "| all | joint | 2 |" in both.stdout
    assert "[2/2]" in both.stderr
    assert "[1/2]" not in both.stderr
    other = run_benchmark("drives.py", "--drives", 2, *few, "--camera", "ideal")
    assert other.returncode != 0
    assert "give another" in other.stderr


def test_looking_down_is_judged_beside_one_camera(tmp_path: Path) -> None:
    out = tmp_path / "downward.jsonl"
    few = ["--width", 160, "--rate-hz", 5, "--longest-m", 8, "--workers", 1, "--out", out]
    first = run_benchmark("downward.py", "--drives", 2, *few)
    assert first.returncode == 0, first.stdout + first.stderr
    assert "[2/2]" in first.stderr
    assert "relief: pitch up to" in first.stdout
    again = run_benchmark("downward.py", "--drives", 2, *few)
    assert (again.returncode, again.stdout, again.stderr) == (0, first.stdout, "")
    flat, relief = (json.loads(line) for line in out.read_text().splitlines())
    assert relief["driven"]["pitch_deg"] > 2 > flat["driven"]["pitch_deg"]
    stereo, one_camera = "stereo, final", "one camera, flat ground"
    for record in (flat, relief):
        assert record[stereo]["lost"] == record[one_camera]["lost"] == 0
        assert record[stereo]["end_percent"] < 1
    assert flat[one_camera]["end_percent"] < 1
    assert relief[one_camera]["segment_percent"] > 4 * relief[stereo]["segment_percent"]


def test_looking_down_fails_where_nothing_was_driven() -> None:
    done = run_benchmark("downward.py", "--drives", 1, "--width", 161, "--workers", 1)
    assert done.returncode == 1
    assert "failed: 0: InputError: width 161" in done.stdout


def test_cost_of_two_pairs_is_measured_on_kept_pictures(tmp_path: Path) -> None:
    few = ["--width", 160, "--repeats", 1, "--pictures", tmp_path / "kept.npz"]
    first = run_benchmark("two_pairs.py", "--instants", 5, *few)
    assert first.returncode == 0, first.stdout + first.stderr
    again = run_benchmark("two_pairs.py", "--instants", 5, *few)
    _, size, points, instants, *figures, _ = again.stdout.splitlines()[-1].split("|")
    assert [word.strip() for word in (size, points, instants)] == ["160x120", "400", "5"]
    assert all(float(figure) > 0 for figure in figures)
    other = run_benchmark("two_pairs.py", "--instants", 6, *few)
    assert other.returncode != 0
    assert "give another" in other.stderr


def test_correlation_prints_its_tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    standpoint = tmp_path / "nao_marks" / "point1"
    standpoint.mkdir(parents=True)
    grain = np.random.default_rng(1).integers(0, 256, (480, 640), np.uint8)
    cv2.imwrite(str(standpoint / "imagebottom.jpg"), cv2.GaussianBlur(grain, (0, 0), 1.5))
    monkeypatch.setenv("PILOTAGE_DATA", str(tmp_path))
    done = run_benchmark("correlation.py", "--surfaces", "gravel")
    assert done.returncode == 0, done.stdout + done.stderr
    row = next(line for line in done.stdout.splitlines() if line.startswith("| gravel, 0.7 mm"))
    _, _, peak, rival, nodes, rms, bias, motions, _, _ = (word.strip() for word in row.split("|"))
    assert float(peak) > 0.8
    assert float(rival) < 0.9
    assert nodes == "100 %"
    assert float(rms) < 0.15
    assert float(bias) < 0.05
    assert motions == "12 of 12"
    assert "| nao_marks, point1 |" in done.stdout
    assert "matchTemplate" in done.stdout


def test_rendering_and_surfaces_print_their_tables() -> None:
    arguments = ["--width", 160, "--steps", 5, "--grounds", "soil"]
    done = run_benchmark("rendering.py", *arguments)
    assert done.returncode == 0, done.stdout + done.stderr
    row = done.stdout.splitlines()[-1]
    assert row.startswith("| soil | 160x120 |")
    if "without MuJoCo's renderer" not in done.stderr:
        assert float(row.split("|")[-2].strip(" %")) > 99
    done = run_benchmark("surfaces.py")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "| rendered gravel, 1.4 mm a pixel |" in done.stdout


def test_perfect_poses_are_judged_perfect() -> None:
    truth = straight_path(30, 0.5)
    figures = judge("street", a_run(truth, 1e-4 * np.eye(6)), truth)
    assert figures["ate_m"] == pytest.approx(0, abs=1e-9)
    assert figures["segment_percent"] == pytest.approx(0, abs=1e-6)
    assert figures["scale"] == pytest.approx(1)
    assert figures["steps_solved"] == 29
    assert figures["confidently_wrong"] == 0


def test_a_wrong_scale_with_small_covariance_is_confidently_wrong() -> None:
    truth = straight_path(30, 0.5)
    estimate = straight_path(30, 0.55)
    figures = judge("street", a_run(estimate, 1e-6 * np.eye(6)), truth)
    assert figures["scale"] == pytest.approx(1.1)
    assert figures["segment_percent"] == pytest.approx(10, rel=0.1)
    assert figures["confidently_wrong"] == 29
    honest = judge("street", a_run(estimate, np.eye(6)), truth)
    assert honest["confidently_wrong"] == 0


def test_lost_pairs_cost_their_steps() -> None:
    truth = straight_path(10, 0.5)
    estimate = truth.copy()
    estimate[4] = np.nan
    figures = judge("street", a_run(estimate), truth)
    assert figures["lost"] == 1
    assert figures["steps_solved"] == 7
    assert figures["steps_wrong"] == 0


def test_a_jump_is_a_wrong_step() -> None:
    truth = straight_path(10, 0.5)
    estimate = truth.copy()
    estimate[5:, 0, 3] += 1.0
    figures = judge("street", a_run(estimate), truth)
    assert figures["steps_wrong"] == 1
    assert figures["step_max_m"] == pytest.approx(1.0)


def test_zed_steps_are_held_against_100_mm() -> None:
    figures = judge("zed_steps", a_run(straight_path(8, 0.103)), None)
    assert figures["step_max_m"] == pytest.approx(0.003)
    assert figures["steps_solved"] == 7


def test_lost_zed_steps_miss_their_goal() -> None:
    estimate = straight_path(8, 0.1)
    estimate[3] = np.nan
    figures = judge("zed_steps", a_run(estimate), None)
    assert figures["steps_solved"] == 5
    assert Goal("zed_steps", "step_max_m", "<=", 0.004).is_met(figures) is False


def test_a_run_that_is_lost_throughout_misses_its_goals() -> None:
    truth = straight_path(10, 0.5)
    estimate = np.full_like(truth, np.nan)
    figures = judge("kitti_a", a_run(estimate), truth)
    assert figures["lost"] == 10
    assert Goal("kitti_a", "ate_m", "<=", 0.045).is_met(figures) is False


def test_no_calibration_check_is_no_clean_bill() -> None:
    truth = straight_path(10, 0.5)
    goal = Goal("kitti_a", "alarm", "==", 0)
    assert goal.is_met(judge("kitti_a", a_run(truth), truth)) is None
    for verdict, met in (("consistent", True), ("inconsistent", False)):
        run = {**a_run(truth), "check": np.array(json.dumps({"verdict": verdict}))}
        assert goal.is_met(judge("kitti_a", run, truth)) is met


def test_goals_tell_pass_miss_and_unmeasured() -> None:
    goal = Goal("kitti_a", "ate_m", "<=", 0.045)
    assert goal.is_met({"ate_m": 0.04}) is True
    assert goal.is_met({"ate_m": 0.05}) is False
    assert goal.is_met({"ate_m": math.nan}) is None
    row = {"recording": "kitti_a", "name": "kitti_a", "every": 1, "system": "pilotage-patch"}
    verdicts = {line[2]: line[5] for line in goal_rows([{**row, "ate_m": 0.05, "cpu_ms": 9.0}])}
    assert verdicts["ate_m"] == "MISS"
    assert verdicts["cpu_ms"] == "PASS"
    assert verdicts["peak_mb"] == "not measured"
    assert goal_rows([{**row, "system": "opencv"}]) == []


def test_costs_take_the_least_time_and_the_largest_memory() -> None:
    runs = [
        {"costs_ms": np.full((4, 2), ms), "finish_cpu_ms": ms, "peak_mb": ms} for ms in (8.0, 5.0)
    ]
    figures = costs(runs)
    assert figures["cpu_ms"] == 5
    assert figures["finish_cpu_ms"] == 5
    assert figures["peak_mb"] == 8


def test_ratio_is_opencv_over_the_other() -> None:
    rows = with_ratio([{"system": "pilotage-patch", "cpu_ms": 10.0},
                       {"system": "opencv", "cpu_ms": 90.0}])  # fmt: skip
    assert rows[0]["cpu_ratio"] == 9
    assert "cpu_ratio" not in rows[1]


def test_replay_turns_round_without_standing_still() -> None:
    assert list(there_and_back(4, 9)) == [0, 1, 2, 3, 2, 1, 0, 1, 2]
    assert list(there_and_back(1, 3)) == [0, 0, 0]


def test_slope_ignores_the_start_and_finds_growth() -> None:
    warm_up = [(0, 10.0), (500, 60.0), (1000, 80.0), (1500, 80.0), (2000, 80.0)]
    assert slope_kb_per_pair(warm_up) == pytest.approx(0, abs=1e-9)
    growing = [(i, 50 + i / 1024 * 2) for i in range(0, 2000, 100)]
    assert slope_kb_per_pair(growing) == pytest.approx(2)


def test_tables_align_and_leave_out_empty_columns() -> None:
    assert markdown_table(["a", "b", "c"], [["1", "", "22"], ["333", "", "4"]]) == (
        "| a   | c  |\n|-----|----|\n| 1   | 22 |\n| 333 | 4  |"
    )
    assert [number(v) for v in (7.0, 0.012345, math.nan, 1234.56)] == ["7", "0.01235", "", "1235"]
