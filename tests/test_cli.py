# SPDX-License-Identifier: Apache-2.0
# Long: every verb, every exit code, through the real program.
"""The program itself, from recording to report, and its exit codes."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from evo.core.metrics import APE, PoseRelation
from evo.core.sync import associate_trajectories
from evo.tools.file_interface import read_kitti_poses_file, read_tum_trajectory_file
from program import call
from synthetic import SyntheticRecording, make_long_recording, make_recording

from pilotage.pose_files import read_pose_table
from pilotage.results import FILES, POSES_LIVE, ResultsFolder, read_results

PROGRAM = [sys.executable, "-m", "pilotage.cli.main"]


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [*PROGRAM, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def finished(synthetic_kitti: SyntheticRecording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A results folder of the whole chain."""
    out = tmp_path_factory.mktemp("cli") / "out"
    done = run("localize", synthetic_kitti.path, "-o", out)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert re.search(r"Tracked 20 of 20 pairs", done.stdout)
    assert "pairs/s" in done.stderr
    return out


def test_localize_leaves_every_file(finished: Path):
    assert {path.name for path in finished.iterdir()} == set(FILES)


def test_trajectory_is_the_truth(finished: Path, synthetic_kitti: SyntheticRecording):
    estimate = read_tum_trajectory_file(finished / "trajectory_tum.txt")
    truth = read_tum_trajectory_file(finished / "truth_tum.txt")
    truth, estimate = associate_trajectories(truth, estimate)
    assert estimate.num_poses == len(synthetic_kitti.timestamps_ns)
    estimate.align(truth)
    ape = APE(PoseRelation.translation_part)
    ape.process_data((truth, estimate))
    evaluation = json.loads((finished / "evaluation.json").read_text())
    assert evaluation["ate_rmse_m"] == pytest.approx(ape.get_statistic(_rmse()), rel=1e-4)
    assert evaluation["ate_rmse_m"] < 0.02
    kitti = read_kitti_poses_file(finished / "trajectory_kitti.txt")
    assert kitti.num_poses == 20


def _rmse():
    from evo.core.metrics import StatisticsType

    return StatisticsType.rmse


def test_summary_adds_up(finished: Path):
    summary = read_results(finished).summary
    parts = [summary[key] for key in ("tracked", "degraded", "lost", "skipped")]
    assert sum(parts) == summary["pairs"] == 20
    assert summary["state"] == "finished"
    assert summary["cpu_ms_per_pair"] > 0
    assert 20 < summary["peak_rss_mb"] < 400
    assert summary["calibration_check"]["verdict"] != "inconsistent"


def test_every_pose_has_a_positive_covariance(finished: Path):
    for record in read_results(finished).records[1:]:
        assert record.covariance is not None
        assert np.linalg.eigvalsh(record.covariance)[0] > 0


def test_report_fetches_nothing(finished: Path):
    page = (finished / "report.html").read_text()
    assert len(page) < 3_000_000
    assert "Tracked 20 of 20 pairs" in page
    assert page.count("<svg") == 7
    fetched = re.findall(r"(?:src|href)\s*=\s*['\"]([^'\"#][^'\"]*)", page)
    # The pictures are in the page itself.
    assert len(fetched) == 1
    assert fetched[0].startswith("data:image/jpeg;base64,")
    assert "@import" not in page
    assert "url(http" not in page


def test_used_config_and_calibration_run_again_to_the_same_bytes(
    finished: Path, synthetic_kitti: SyntheticRecording, tmp_path: Path
):
    again = tmp_path / "again"
    used = ["--config", finished / "config.yaml", "--calibration", finished / "calibration.yaml"]
    done = call("localize", synthetic_kitti.path, "-o", again, "--no-report", *used)
    assert done.exit_code == 0, done.output
    for name in ("trajectory_tum.txt", "trajectory_kitti.txt", "poses.csv", "points.ply"):
        assert (again / name).read_bytes() == (finished / name).read_bytes(), name
    assert not (again / "report.html").exists()


def test_evaluate_prints_and_writes(finished: Path, synthetic_kitti: SyntheticRecording):
    done = call("evaluate", finished, "--truth", synthetic_kitti.path, "--align", "origin")
    assert done.exit_code == 0, done.output
    assert "translation over segments" in done.output
    evaluation = json.loads((finished / "evaluation.json").read_text())
    assert evaluation["alignment"] == "origin"
    assert evaluation["ate_max_m"] == pytest.approx(evaluation["origin_error_max_m"])
    call("evaluate", finished, "--truth", synthetic_kitti.path)


def test_euroc_truth_of_the_body_is_carried_to_the_camera(
    synthetic_euroc: SyntheticRecording, tmp_path: Path
):
    out = tmp_path / "out"
    done = call("localize", synthetic_euroc.path, "-o", out, "--no-report")
    assert done.exit_code == 0, done.output
    files = sorted(synthetic_euroc.path.rglob("state_groundtruth_estimate0/data.csv"))
    done = call("evaluate", out, "--truth", files[0] if files else synthetic_euroc.path)
    assert done.exit_code == 0, done.output
    assert json.loads((out / "evaluation.json").read_text())["ate_rmse_m"] < 0.02


def test_part_of_a_recording(synthetic_kitti: SyntheticRecording, tmp_path: Path):
    out = tmp_path / "out"
    part = ["--start", 2, "--end", 17, "--every", 3]
    assert call("localize", synthetic_kitti.path, "-o", out, "--no-report", *part).exit_code == 0
    assert [record.index for record in read_results(out).records] == [2, 5, 8, 11, 14]


def test_one_bad_pair_is_skipped_and_told(tmp_path: Path):
    recording = make_recording(tmp_path / "recording", truncated=(5,), frames=12)
    done = run("localize", recording.path, "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    summary = read_results(tmp_path / "out").summary
    assert summary["skipped"] == 1
    assert summary["skipped_pairs"][0]["index"] == 5
    assert "warning: 1 pair could not be read" in done.stderr
    kitti = (tmp_path / "out" / "trajectory_kitti.txt").read_text().splitlines()
    assert [number for number, line in enumerate(kitti) if "nan" in line] == [5]


def test_nothing_tracked_is_a_failure_with_a_remedy(tmp_path: Path):
    recording = make_recording(tmp_path / "recording", frames=6, dark=tuple(range(6)))
    done = run("localize", recording.path, "-o", tmp_path / "out")
    assert done.returncode == 1
    assert "nothing was tracked" in done.stderr
    assert (tmp_path / "out" / "report.html").exists()


def _heed_interrupts() -> None:
    # A shell lets what it runs in the background ignore Ctrl-C, and children inherit that.
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.mark.parametrize("asked", [signal.SIGINT, signal.SIGTERM])
def test_interrupt_keeps_what_was_computed(
    synthetic_kitti: SyntheticRecording, tmp_path: Path, asked: signal.Signals
):
    recording = make_long_recording(tmp_path / "long", synthetic_kitti, 5000)
    out = tmp_path / "out"
    command = [*PROGRAM, "localize", str(recording.path), "-o", str(out), "--no-report"]
    with subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        preexec_fn=_heed_interrupts,  # noqa: PLW1509
    ) as running:
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and _lines(out / POSES_LIVE) < 10:
            time.sleep(0.02)
        running.send_signal(asked)
        said = running.communicate()[1].decode()
    assert running.returncode == 1
    assert "interrupted after" in said
    results = read_results(out)
    assert results.summary["state"] == "interrupted"
    assert results.adjusted
    live = read_pose_table(out / POSES_LIVE)
    assert 9 <= len(live) <= len(results.records) < 5000
    assert len((out / "trajectory_tum.txt").read_text().splitlines()) >= 9


def _lines(path: Path) -> int:
    return path.read_text().count("\n") if path.exists() else 0


def test_full_disk_names_the_file_and_keeps_the_rest(
    synthetic_kitti: SyntheticRecording, tmp_path: Path
):
    """A limit on the size of files stands for the full disk."""
    limited = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (2500, 2500))\n"
        "from pilotage.cli.main import main; main()\n"
    )
    out = tmp_path / "out"
    arguments = ["localize", str(synthetic_kitti.path), "-o", str(out), "--no-report"]
    done = subprocess.run(
        [sys.executable, "-c", limited, *arguments], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert re.search(r"error: cannot write \S*poses_live\.csv: ", done.stderr)
    assert "Traceback" not in done.stderr
    assert len(read_pose_table(out / POSES_LIVE)) >= 3
    assert len(read_tum_trajectory_file(out / "trajectory_live_tum.txt").timestamps) >= 3


def test_misuse_is_two_and_one_clear_line(synthetic_kitti: SyntheticRecording, tmp_path: Path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "word.yaml").write_text("pionts: 500\n")
    (tmp_path / "range.yaml").write_text("points: -3\n")
    (tmp_path / "rig.yaml").write_text("left: {fx_px: .nan}\nright: {}\n")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").write_text("")
    recording, out = synthetic_kitti.path, ["-o", tmp_path / "out"]
    for arguments, said in [
        (["localize", tmp_path / "absent", *out], "absent"),
        (["localize", tmp_path / "empty", *out], "empty"),
        (
            ["localize", recording, *out, "--config", tmp_path / "word.yaml"],
            "word.yaml.*pionts",
        ),
        (["localize", recording, *out, "--config", tmp_path / "range.yaml"], "range.yaml.*points"),
        (["localize", recording, *out, "--config", tmp_path / "none.yaml"], "none.yaml"),
        (["localize", recording, *out, "--set", "pionts=500"], "--set pionts=500.*unknown key"),
        (["localize", recording, *out, "--set", "points"], "KEY=VALUE"),
        (["localize", recording, *out, "--set", "points=many"], "points"),
        (["localize", recording, *out, "--calibration", tmp_path / "rig.yaml"], "rig.yaml"),
        (["localize", recording, *out, "--every", 0], "--every 0"),
        (["localize", recording, *out, "--start", 99], "20 pairs"),
        (["localize", recording, *out, "--start", 5, "--end", 5], "--end 5"),
        (["localize", recording, "-o", tmp_path / "full"], "other things"),
        (["evaluate", tmp_path / "empty"], "not a results folder"),
    ]:
        done = call(*arguments)
        assert done.exit_code == 2, (arguments, done.output)
        lines = done.stderr.strip().splitlines()
        assert len(lines) == 1, lines
        assert re.search(said, lines[0]), lines[0]
        assert lines[0].startswith("error: ")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("arguments", [["localise"], ["localize"], ["localize", "x", "--evry"]])
def test_unknown_verbs_and_options_are_misuse(arguments: list[str]):
    assert call(*arguments).exit_code == 2


def test_evaluate_refuses_truth_that_does_not_meet(finished: Path, tmp_path: Path):
    (tmp_path / "late.txt").write_text("9e8 0 0 0 0 0 0 1\n9.1e8 0 0 0 0 0 0 1\n")
    done = call("evaluate", finished, "--truth", tmp_path / "late.txt")
    assert done.exit_code == 2
    assert "fewer than two pairs" in done.stderr


def test_results_are_not_overwritten_unasked(finished: Path, synthetic_kitti: SyntheticRecording):
    before = (finished / "poses.csv").stat().st_mtime_ns
    done = call("localize", synthetic_kitti.path, "-o", finished)
    assert done.exit_code == 2
    assert "--overwrite" in done.stderr
    assert (finished / "poses.csv").stat().st_mtime_ns == before


def test_fault_of_the_program_has_no_traceback_unless_asked(
    synthetic_kitti: SyntheticRecording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def broken(*_: object) -> None:
        raise ZeroDivisionError("by design")

    monkeypatch.setattr(ResultsFolder, "write_config", broken)
    arguments = ["localize", synthetic_kitti.path, "-o", tmp_path / "out"]
    done = call(*arguments)
    assert done.exit_code == 1
    assert "error: a fault of the program, ZeroDivisionError: by design" in done.stderr
    assert isinstance(call(*arguments, "--overwrite", "--debug").exception, ZeroDivisionError)


def test_version_and_help():
    assert re.fullmatch(r"pilotage \S+\n", call("--version").output)
    for verb in ("localize", "evaluate"):
        words = [line for line in call(verb, "--help").output.splitlines() if line.strip()]
        assert f"Example: pilotage {verb} " in " ".join(words[:3])


def test_help_does_not_wait_for_heavy_packages():
    asked = "import sys, pilotage.cli.main; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", asked], capture_output=True, text=True, check=True,
        env={**os.environ},
    ).stdout.split()  # fmt: skip
    assert not {"cv2", "matplotlib", "scipy", "evo", "pandas"} & set(loaded)
