# SPDX-License-Identifier: Apache-2.0
"""A recorded walk with stops: each stop placed in metres, a carried robot told, misuse named."""

from __future__ import annotations

import csv
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from program import call, said, summary_of
from scipy.spatial.transform import Rotation

from pilotage import StopFate, Transform
from pilotage.behaviors.square_marks import MarkSize
from pilotage.behaviors.walk import PlacedWalk, place_walk, what_became
from pilotage.behaviors.walk_account import RecordedWalk, read_walk
from pilotage.behaviors.walk_folder import against_truth, reconstruct_recording
from pilotage.errors import InputError
from pilotage.evaluation.model_report import what_is_missing
from pilotage.models import read_colmap_binary
from pilotage.models.ply import read_ply
from pilotage.pose_files import AXES, UPPER_TRIANGLE
from pilotage.recordings import SinglePicture, open_pictures
from pilotage.recordings.motion import nearest
from pilotage.stop_files import STOP_COLUMNS

WALK = ["--robot", "nao", "--seed", 3, "--set", "person=sit", "--width", 320]
STOPS, LOOKS = 6, 6
TORSO_M = (0.30, 0.36)  # a Nao's torso above the floor, standing


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("walk") / "office"
    done = call("simulate", "office", "-o", out, *WALK, "--path", "straight-2m", "--stop-every", 8)
    assert done.exit_code == 0, done.output
    assert f"{STOPS} stops" in done.output
    return out


@pytest.fixture(scope="module")
def walk(recording: Path) -> RecordedWalk:
    return read_walk(open_pictures(recording))


@pytest.fixture(scope="module")
def placed(recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("placed") / "out"
    done = call("reconstruct", recording, "-o", out)
    assert done.exit_code == 0, done.output
    assert f"{STOPS} of {STOPS} stops placed" in said(done)
    assert "against the truth: last stop off by" in said(done)
    return out


def true_poses(walk: RecordedWalk) -> np.ndarray:
    """Return (S, 4, 4) true poses of the robot at the stops, from the first."""
    truth = walk.recording.truth("robot")
    assert truth is not None
    found = [nearest(truth.timestamps_ns, p.timestamp_ns, within_ns=10**8) for p in walk.firsts]
    poses = truth.poses[[at for at in found if at is not None]]
    assert len(poses) == len(walk.firsts)
    return np.linalg.inv(poses[0]) @ poses


def rows_of(out: Path) -> list[dict[str, str]]:
    with (out / "stops.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def errors_of(placed: PlacedWalk, true: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return each stop's error from the first placed one and its own standard error, metres."""
    poses = placed.world_from_stop
    first = int(np.flatnonzero(~np.isnan(poses[:, 0, 0]))[0])
    errors = np.linalg.inv(true[first]) @ true - poses
    sigmas = [np.sqrt(np.trace(stop.covariance[:3, :3])) for stop in placed.stops]
    return np.linalg.norm(errors[:, :3, 3], axis=1), np.array(sigmas)


def test_every_stop_is_where_the_robot_stood(placed: Path, walk: RecordedWalk):
    true = true_poses(walk)
    rows = rows_of(placed)
    assert [row["fate"] for row in rows] == ["placed"] * STOPS
    for row, pose, first in zip(rows, true, walk.firsts, strict=True):
        assert int(row["timestamp_ns"]) == first.timestamp_ns
        place = np.array([float(row[f"{axis}_m"]) for axis in "xyz"])
        turn = Rotation.from_quat([float(row[f"q{axis}"]) for axis in "xyzw"])
        left = turn.inv() * Rotation.from_matrix(pose[:3, :3])
        off_m, off_rad = np.linalg.norm(place - pose[:3, 3]), left.magnitude()
        assert off_m < 0.03
        assert off_rad < np.radians(0.5)
        if first is walk.firsts[0]:
            continue
        covariance = np.zeros((6, 6))
        for at in UPPER_TRIANGLE:
            value = float(row[f"cov_{AXES[at[0]]}_{AXES[at[1]]}"])
            covariance[at] = covariance[at[::-1]] = value
        assert np.linalg.eigvalsh(covariance)[0] > 0
        assert off_m < 5 * np.sqrt(np.trace(covariance[:3, :3])) < 0.15
        assert off_rad < 5 * np.sqrt(np.trace(covariance[3:, 3:])) < 0.05


def test_the_folder_is_whole(placed: Path, walk: RecordedWalk):
    summary = summary_of(placed)
    assert summary["state"] == "done"
    assert summary["verdict"] == "whole"
    assert summary["unit"] == "m"
    assert summary["pictures"] == summary["posed"] == STOPS * LOOKS
    assert summary["stops"] == summary["stops_placed"] == STOPS
    assert summary["stops_carried"] == summary["stops_lost"] == summary["unreadable"] == []
    assert summary["moving_pictures"] == 0
    assert [int(row["set_aside"]) for row in rows_of(placed)] == summary["set_aside"]
    lengths = summary["lengths"]
    assert len(lengths["sources"]) >= 2
    for source in [*lengths["sources"], lengths]:
        assert abs(source["factor"] - 1) < 5 * source["sigma"]
    assert summary["truth"]["home_m"] < 0.03
    assert summary["truth"]["largest_m"] < 0.03
    assert abs(summary["truth"]["scale"] - 1) < 0.02

    header = (placed / "stops.csv").read_text().splitlines()[0]
    assert header == ",".join(STOP_COLUMNS)
    model = read_colmap_binary(placed / "colmap_binary")
    assert set(model.names) == {file.name for file in (placed / "pictures").iterdir()}
    shown = cv2.imread(str(placed / "pictures" / walk.names[-1]), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(shown, walk.pictures[-1].picture)
    assert len(read_ply(placed / "points.ply")[0]) == summary["points"]
    cameras = [np.loadtxt(placed / f"trajectory_{name}_tum.txt") for name in ("top", "bottom")]
    assert sum(map(len, cameras)) == summary["posed"]
    assert all((np.diff(camera[:, 0]) > 0).all() for camera in cameras)
    assert not (placed / "trajectory_tum.txt").exists()
    torso = np.loadtxt(placed / "trajectory_torso_tum.txt")
    assert len(torso) == STOPS
    assert TORSO_M[0] < torso[:, 3].min()
    assert torso[:, 3].max() < TORSO_M[1]
    page = (placed / "report.html").read_text()
    assert "<h2>Stops</h2>" in page
    assert page.count("<td>placed</td>") == STOPS
    assert "How long a metre is" in page
    assert "Stops that are not where steps led" not in page


def moved(picture: SinglePicture, new_from_old: Transform) -> SinglePicture:
    assert picture.odom_from_robot is not None
    return replace(picture, odom_from_robot=new_from_old @ picture.odom_from_robot)


def without(walk: RecordedWalk, left_out: range) -> RecordedWalk:
    """Return the walk as of a robot that was carried over some stops and knows nothing of it.

    Its odometry claims that it walked the step to the first of them, and no other.
    """
    after = left_out.stop
    here, there = (walk.firsts[stop].odom_from_robot for stop in (left_out.start, after))
    assert here is not None
    assert there is not None
    claimed = here @ there.inverse()
    pictures, stops = [], []
    for stop, picture in zip(walk.stop_of_picture, walk.pictures, strict=True):
        if stop not in left_out:
            pictures.append(moved(picture, claimed) if stop >= after else picture)
            stops.append(stop - len(left_out) if stop >= after else stop)
    return replace(walk, pictures=tuple(pictures), stop_of_picture=tuple(stops))


def test_a_carried_robot_is_not_where_its_steps_led(walk: RecordedWalk):
    left_out = range(2, 4)
    carried = place_walk(without(walk, left_out))
    fates = [stop.fate for stop in carried.stops]
    assert len(fates) == STOPS - len(left_out)
    assert set(fates[:2]) == {StopFate.placed}
    assert fates[left_out.start] in {StopFate.carried, StopFate.lost}
    words = what_became(carried.stops)
    assert len(words) == 1
    assert "carried" in words[0]
    assert what_is_missing("; ".join(words)) == words
    true = np.delete(true_poses(walk), left_out, axis=0)
    errors, sigmas = errors_of(carried, true)
    known = ~np.isnan(errors)
    assert known.sum() >= 2
    assert (errors[known] < 5 * sigmas[known] + 0.05).all()


def test_a_stop_that_shows_another_room_is_lost(walk: RecordedWalk):
    random = np.random.default_rng(1)
    pictures = list(walk.pictures)
    for i, stop in enumerate(walk.stop_of_picture):
        if stop == STOPS - 1:
            noise = random.integers(0, 255, (60, 80), np.uint8)
            pictures[i] = replace(pictures[i], picture=cv2.resize(noise, (320, 240)))
    lost = place_walk(replace(walk, pictures=tuple(pictures)))
    assert [stop.fate.name for stop in lost.stops] == ["placed"] * (STOPS - 1) + ["lost"]
    assert lost.stops[-1].world_from_stop is None
    assert lost.world_from_torso[-1] is None
    (words,) = what_became(lost.stops)
    assert words.startswith(f"stop {STOPS - 1}: lost")
    assert what_is_missing(words) == [words]
    truth = against_truth(lost)
    assert truth is not None
    assert truth["largest_m"] < 0.03


class Rewritten:
    """A recording whose pictures tell something else, as one by another robot would."""

    def __init__(self, recording: Path, **told: object) -> None:
        self._whole = open_pictures(recording)
        self._told = told
        self.name, self.path, self.cameras = "other", recording, self._whole.cameras

    def __len__(self) -> int:
        return len(self._whole)

    def pictures(self):
        for picture in self._whole.pictures():
            assert isinstance(picture, SinglePicture)
            yield replace(picture, **self._told)

    def truth(self, frame: str):
        return self._whole.truth(frame)


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ({"robot_from_camera": None}, ["not told where it is on the robot", "/tf", "folder"]),
        ({"odom_from_robot": None}, ["no odometry (/odom)", "folder"]),
        ({"odom_from_robot": Transform()}, ["stood in one place only", "mosaic", "localize"]),
        ({"is_moving": True}, [f"all {STOPS * LOOKS} pictures were taken on the way", "localize"]),
    ],
)
def test_what_a_recording_does_not_tell_is_named(
    recording: Path, told: dict[str, object], words: list[str]
):
    with pytest.raises(InputError) as refused:
        read_walk(Rewritten(recording, **told))
    for word in [str(recording), *words]:
        assert word in str(refused.value)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--fov-deg", "60"], "--fov-deg: a recording tells that itself; leave it out"),
        (["--unordered"], "--unordered: a recording tells that itself"),
        (["--set", "motions=9"], "motions"),
        (["--set", "motion=2"], "motions"),
    ],
)
def test_options_that_make_no_sense_are_refused(
    recording: Path, tmp_path: Path, arguments: list[str], words: str
):
    done = call("reconstruct", recording, "-o", tmp_path / "out", *arguments)
    assert done.exit_code == 2, done.output
    assert words in said(done)
    assert not (tmp_path / "out").exists()


def test_a_file_cut_off_is_refused_with_the_remedy(recording: Path, tmp_path: Path):
    whole = (recording / "recording.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) // 2])
    done = call("reconstruct", cut, "-o", tmp_path / "out")
    assert done.exit_code == 2, done.output
    assert "cut.mcap" in said(done)
    assert "pilotage recover" in said(done)


def test_a_folder_that_is_taken_is_left_alone(recording: Path, tmp_path: Path):
    mine = tmp_path / "mine" / "letter.txt"
    mine.parent.mkdir()
    mine.write_text("mine")
    done = call("reconstruct", recording, "-o", mine.parent)
    assert done.exit_code == 2, done.output
    assert str(mine.parent) in done.output.replace("\n", "")
    assert [file.name for file in mine.parent.iterdir()] == ["letter.txt"]


def test_results_are_replaced_only_when_told(placed: Path, recording: Path, tmp_path: Path):
    out = tmp_path / "out"
    shutil.copytree(placed, out)
    with pytest.raises(InputError, match="overwrite"):
        reconstruct_recording(recording=recording, out=out)
    (out / "pictures" / "stop099_0999_top.png").write_bytes(b"of a longer walk")
    marks = MarkSize(side_m=0.16, family="apriltag-36h11")
    summary = reconstruct_recording(recording=recording, out=out, marks=marks, overwrite=True)
    assert summary["length_fault"].endswith("lengths are by joints, steps and floor alone")
    assert len(list((out / "pictures").iterdir())) == summary["pictures"]
    assert (out / "stops.csv").read_bytes() == (placed / "stops.csv").read_bytes()
