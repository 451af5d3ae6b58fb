# SPDX-License-Identifier: Apache-2.0
"""The results folder: written, read back, refused, and cut short."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from evo.tools.file_interface import read_kitti_poses_file, read_tum_trajectory_file

from pilotage.atomic_files import write_atomically
from pilotage.errors import InputError, RunError
from pilotage.pose_files import PoseRecord, kitti_line, read_pose_table, seconds, tum_line
from pilotage.results import (
    KITTI,
    POSES,
    POSES_LIVE,
    SUMMARY,
    TUM,
    TUM_LIVE,
    ResultsFolder,
    claim_folder,
    is_results_folder,
    ply_bytes,
    read_results,
)

START_NS = 1_403_636_579_763_555_584


def tracked(index: int, **changes: object) -> PoseRecord:
    angle = 0.02 * index
    covariance = np.diag(np.arange(1.0, 7.0)) * 1e-4 + 1e-6 * index
    known = PoseRecord(
        index=index,
        timestamp_ns=START_NS + index * 50_000_000,
        status="tracking",
        position_m=(0.5 * index, -0.25 * index, 0.125),
        quaternion_wxyz=(float(np.cos(angle)), 0.0, float(np.sin(angle)), 0.0),
        covariance=covariance,
        matches=300 + index,
        inliers=200 + index,
        residual_px=0.25,
        y_parallax_px=0.125,
        is_keyframe=index % 5 == 0,
    )
    return dataclasses.replace(known, **changes)  # type: ignore[arg-type]


def lost(index: int) -> PoseRecord:
    return PoseRecord(index, START_NS + index * 50_000_000, "lost", "too_dark", segment=1)


def same(a: PoseRecord, b: PoseRecord) -> bool:
    left, right = dataclasses.asdict(a), dataclasses.asdict(b)
    return all(
        np.allclose(left[key], right[key], rtol=1e-9, atol=0, equal_nan=True)
        if left[key] is not None and not isinstance(left[key], str)
        else left[key] == right[key]
        for key in left
    )


def test_pose_table_comes_back(tmp_path: Path):
    records = [tracked(0), lost(1), tracked(2, status="degraded", reason="blurred", segment=1)]
    with ResultsFolder(tmp_path / "out") as folder:
        folder.write_trajectory(records)
    back = read_pose_table(tmp_path / "out" / POSES)
    assert len(back) == 3
    assert all(same(a, b) for a, b in zip(records, back, strict=True))


def test_evo_reads_both_trajectories(tmp_path: Path):
    records = [tracked(index) for index in range(8)]
    with ResultsFolder(tmp_path / "out") as folder:
        folder.write_trajectory(records)
    tum = read_tum_trajectory_file(tmp_path / "out" / TUM)
    kitti = read_kitti_poses_file(tmp_path / "out" / KITTI)
    np.testing.assert_allclose(tum.positions_xyz, [record.position_m for record in records])
    np.testing.assert_allclose(
        tum.orientations_quat_wxyz, [record.quaternion_wxyz for record in records], atol=1e-9
    )
    np.testing.assert_allclose(kitti.poses_se3, tum.poses_se3, atol=1e-8)


def test_lost_pair_is_left_out_of_tum_and_nan_in_kitti():
    assert tum_line(lost(3)) == ""
    assert kitti_line(lost(3)).split() == ["nan"] * 12


def test_seconds_lose_no_digit():
    assert seconds(START_NS) == "1403636579.763555584"
    assert seconds(5) == "0.000000005"
    assert seconds(-1_500_000_000) == "-1.500000000"


def test_live_files_can_be_read_at_any_time(tmp_path: Path):
    out = tmp_path / "out"
    with ResultsFolder(out) as folder:
        for index in range(3):
            folder.append_live(tracked(index))
        assert len(read_pose_table(out / POSES_LIVE)) == 3
        assert len((out / TUM_LIVE).read_text().splitlines()) == 3
        results = read_results(out)
    assert results.summary["state"] == "running"
    assert not results.adjusted
    assert len(results.records) == 3


def test_killed_run_leaves_what_it_knew(tmp_path: Path):
    program = (
        "import os, sys; from pathlib import Path\n"
        "sys.path.insert(0, sys.argv[2]); from test_results import tracked\n"
        "from pilotage.results import ResultsFolder\n"
        "with ResultsFolder(Path(sys.argv[1])) as folder:\n"
        "    for index in range(50): folder.append_live(tracked(index))\n"
        "    os.kill(os.getpid(), 9)\n"
    )
    arguments = [str(tmp_path / "out"), str(Path(__file__).parent)]
    subprocess.run([sys.executable, "-c", program, *arguments], check=False)
    results = read_results(tmp_path / "out")
    assert [record.index for record in results.records] == list(range(50))


def test_line_cut_short_is_left_out(tmp_path: Path):
    with ResultsFolder(tmp_path / "out") as folder:
        for index in range(3):
            folder.append_live(tracked(index))
    table = tmp_path / "out" / POSES_LIVE
    table.write_text(table.read_text()[:-20])
    assert len(read_pose_table(table)) == 2


@pytest.mark.parametrize("line", ["1,2,3\n", "x" + ",1" * 37 + "\n"])
def test_bad_table_names_its_line(tmp_path: Path, line: str):
    with ResultsFolder(tmp_path / "out") as folder:
        folder.write_trajectory([tracked(0)])
    table = tmp_path / "out" / POSES
    table.write_text(table.read_text() + line)
    with pytest.raises(InputError, match=r"poses\.csv, line 3"):
        read_pose_table(table)


def test_other_peoples_folder_is_refused(tmp_path: Path):
    (tmp_path / "thesis.tex").write_text("years of work")
    for overwrite in (False, True):
        with (
            pytest.raises(InputError, match="other things"),
            ResultsFolder(tmp_path, overwrite=overwrite),
        ):
            pass
    assert (tmp_path / "thesis.tex").read_text() == "years of work"
    assert list(tmp_path.iterdir()) == [tmp_path / "thesis.tex"]


def test_earlier_results_are_replaced_only_when_told_to(tmp_path: Path):
    out = tmp_path / "out"
    with ResultsFolder(out) as folder:
        folder.write_trajectory([tracked(0)])
    with pytest.raises(InputError, match="--overwrite"), ResultsFolder(out):
        pass
    with ResultsFolder(out, overwrite=True):
        assert not (out / POSES).exists()


def test_a_claimed_folder_loses_what_a_run_left_and_nothing_else(tmp_path: Path):
    for name in ("table.csv", "notes.txt", "pairs/a/poses.csv", "pairs/b/poses.csv", "pairs/b/own"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    claim_folder(tmp_path, ("table.csv", SUMMARY, "pairs/*/poses.csv", "pairs/*/", "pairs/"))
    left = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")}
    assert left == {SUMMARY, "notes.txt", "pairs", "pairs/b", "pairs/b/own"}
    assert is_results_folder(tmp_path)
    (tmp_path / "pairs/b/own").unlink()
    claim_folder(tmp_path, ("pairs/*/", "pairs/"))
    assert not (tmp_path / "pairs").exists()


def test_a_folder_that_cannot_be_cleared_is_named(tmp_path: Path):
    (tmp_path / "depth.csv").mkdir()
    with pytest.raises(InputError, match="cannot use"):
        claim_folder(tmp_path, ("depth.csv",))


def test_file_in_the_way_is_refused(tmp_path: Path):
    (tmp_path / "out").write_text("")
    with pytest.raises(InputError, match="is a file"), ResultsFolder(tmp_path / "out"):
        pass


def test_summary_is_json_for_every_reader(tmp_path: Path):
    with ResultsFolder(tmp_path / "out") as folder:
        folder.write_summary({"a": float("nan"), "b": np.float32(0.5), "c": [np.int64(3)]})
    content = json.loads((tmp_path / "out" / SUMMARY).read_text())
    assert content == {"program": "pilotage", "a": None, "b": 0.5, "c": [3]}
    assert is_results_folder(tmp_path / "out")


def test_full_disk_is_told_and_leaves_the_old_file(tmp_path: Path):
    """A limit on the size of files stands for the full disk: both end a write with an OSError."""
    target = tmp_path / "kept.txt"
    target.write_text("old")
    program = (
        "import resource, sys; from pathlib import Path\n"
        "from pilotage.atomic_files import write_atomically\n"
        "from pilotage.errors import RunError\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        "try: write_atomically(Path(sys.argv[1]), 'x' * 5000)\n"
        "except RunError as error: print(error)\n"
    )
    command = [sys.executable, "-c", program, str(target)]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert f"cannot write {target}" in said
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_write_into_nowhere_names_the_file(tmp_path: Path):
    with pytest.raises(RunError, match="absent"):
        write_atomically(tmp_path / "absent" / "file.txt", "text")


def test_cloud_is_binary_ply_without_points_at_infinity():
    points = np.array([[1, 2, 3], [np.nan, 0, 0], [-4, 5, 6.5]], dtype=np.float32)
    content = ply_bytes(points, np.array([10, 20, 30], dtype=np.uint8))
    header, _, body = content.partition(b"end_header\n")
    assert b"format binary_little_endian 1.0\nelement vertex 2\n" in header
    vertices = np.frombuffer(body, dtype=[("point", "<f4", 3), ("colour", "u1", 3)])
    np.testing.assert_array_equal(vertices["point"], points[[0, 2]])
    np.testing.assert_array_equal(vertices["colour"], [[10] * 3, [30] * 3])
