# SPDX-License-Identifier: Apache-2.0
"""Recordings converted there and back stay what they were."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from full_disk import file_size_limit
from program import call
from synthetic import SyntheticRecording, make_recording
from test_mcap import camera_numbers, make_rig, numbers, write_recording

from pilotage import Rectifier
from pilotage.errors import InputError
from pilotage.recordings import Recording, StereoFrame, open_recording
from pilotage.recordings import convert as convert_module
from pilotage.recordings.convert import convert
from pilotage.results import POSES, TRUTH, TUM

NAMES = {"kitti": "k", "euroc": "e", "mcap": "m.mcap"}


@pytest.fixture(scope="module")
def small_kitti(tmp_path_factory: pytest.TempPathFactory) -> SyntheticRecording:
    return make_recording(tmp_path_factory.mktemp("kitti"), frames=5, width=160, height=96)


@pytest.fixture(scope="module")
def small_euroc(tmp_path_factory: pytest.TempPathFactory) -> SyntheticRecording:
    folder = tmp_path_factory.mktemp("euroc")
    return make_recording(folder, layout="euroc", frames=5, width=160, height=96)


def assert_same(first: Recording, second: Recording, *, rig_atol: float, truth_atol: float) -> None:
    """Pictures and times are identical; calibration and truth as near as said."""
    for a, b in zip(first.frames(), second.frames(), strict=True):
        assert isinstance(a, StereoFrame)
        assert isinstance(b, StereoFrame)
        assert a.timestamp_ns == b.timestamp_ns
        np.testing.assert_array_equal(a.left, b.left)
        np.testing.assert_array_equal(a.right, b.right)
    for side in ("left", "right"):
        cameras = getattr(first.rig, side), getattr(second.rig, side)
        assert camera_numbers(cameras[0]) == camera_numbers(cameras[1])
    assert first.rig.readout_s == second.rig.readout_s
    places = numbers(first.rig.right_from_left), numbers(second.rig.right_from_left)
    np.testing.assert_allclose(places[0], places[1], rtol=0, atol=rig_atol)
    truth, again = first.truth(), second.truth()
    assert truth is not None
    assert again is not None
    np.testing.assert_array_equal(truth.timestamps_ns, again.timestamps_ns)
    np.testing.assert_allclose(
        truth.world_from_left, again.world_from_left, rtol=0, atol=truth_atol
    )


@pytest.mark.parametrize("ways", [("mcap", "kitti"), ("euroc", "kitti"), ("kitti", "mcap")])
def test_kitti_there_and_back(
    ways: tuple[str, str], small_kitti: SyntheticRecording, tmp_path: Path
) -> None:
    source = open_recording(small_kitti.path)
    recording = source
    for number, to in enumerate(ways):
        out = tmp_path / f"{number}{NAMES[to]}"
        assert convert(recording, out, to).pairs == 5
        recording = open_recording(out)
        # The rotations of poses.txt have twelve digits; a quaternion makes true rotations of them.
        rig_atol = 1e-16 if "euroc" in ways else 0
        assert_same(source, recording, rig_atol=rig_atol, truth_atol=1e-12)
    assert {path.name for path in tmp_path.iterdir()} == {
        f"{i}{NAMES[t]}" for i, t in enumerate(ways)
    }


@pytest.mark.parametrize("ways", [("mcap", "euroc"), ("euroc", "mcap")])
def test_euroc_there_and_back(
    ways: tuple[str, str], small_euroc: SyntheticRecording, tmp_path: Path
) -> None:
    source = open_recording(small_euroc.path)
    convert(source, tmp_path / NAMES[ways[0]], ways[0])
    between = open_recording(tmp_path / NAMES[ways[0]])
    convert(between, tmp_path / NAMES[ways[1]], ways[1])
    last = open_recording(tmp_path / NAMES[ways[1]])
    mcap = between if ways[0] == "mcap" else last
    rig_atol = 0 if ways[0] == "mcap" else 1e-15
    assert_same(source, mcap, rig_atol=rig_atol, truth_atol=1e-14)
    assert_same(source, last, rig_atol=1e-15, truth_atol=1e-14)


@pytest.mark.parametrize("to", ["mcap", "euroc"])
@pytest.mark.parametrize("lens", ["none", "brown", "kannala_brandt"])
def test_every_lens_and_the_robot_survive(lens: str, to: str, tmp_path: Path) -> None:
    write_recording(tmp_path / "a.mcap", make_rig(1, lens=lens), 3)
    source = open_recording(tmp_path / "a.mcap")
    done = convert(source, tmp_path / NAMES[to], to)
    again = open_recording(tmp_path / NAMES[to])
    assert_same(source, again, rig_atol=0 if to == "mcap" else 1e-15, truth_atol=1e-14)
    if to == "mcap":
        assert numbers(again.rig.robot_from_left) == numbers(source.rig.robot_from_left)
    else:
        assert "robot" in done.notes[0]


def test_kitti_leaves_the_rolling_shutter_out_and_says_so(tmp_path: Path) -> None:
    write_recording(tmp_path / "a.mcap", make_rig(1, lens="none"), 3)
    source = open_recording(tmp_path / "a.mcap")
    assert source.rig.readout_s > 0
    done = convert(source, tmp_path / "kitti", "kitti")
    assert open_recording(tmp_path / "kitti").rig.readout_s == 0
    assert any("rolling shutter" in note for note in done.notes)


def test_kitti_gets_rectified_pairs(small_euroc: SyntheticRecording, tmp_path: Path) -> None:
    source = open_recording(small_euroc.path)
    done = convert(source, tmp_path / "k", "kitti")
    assert "rectified" in done.notes[0]
    result, rectifier = open_recording(tmp_path / "k"), Rectifier(rig=source.rig)
    assert Rectifier(rig=result.rig).is_identity
    for a, b in zip(source.frames(), result.frames(), strict=True):
        assert isinstance(a, StereoFrame)
        assert isinstance(b, StereoFrame)
        assert a.timestamp_ns == b.timestamp_ns
        np.testing.assert_array_equal(rectifier.rectify(a.left, "left"), b.left)
        np.testing.assert_array_equal(rectifier.rectify(a.right, "right"), b.right)
    truth, again = source.truth(), result.truth()
    assert truth is not None
    assert again is not None
    turn = rectifier.rectified_from_left.inverse().matrix()
    np.testing.assert_allclose(truth.world_from_left @ turn, again.world_from_left, atol=1e-14)


def test_truth_of_other_times_goes_beside_kitti(
    small_kitti: SyntheticRecording, tmp_path: Path
) -> None:
    shutil.copytree(small_kitti.path, tmp_path / "s")
    (tmp_path / "s" / "poses.txt").unlink()
    rows = "".join(f"{i / 50} {i} 0 0 0 0 0.6 0.8\n" for i in range(30))
    (tmp_path / "s" / "truth_left_tum.txt").write_text(rows)
    source = open_recording(tmp_path / "s")
    done = convert(source, tmp_path / "k", "kitti")
    assert "left out" in done.notes[0]  # each pair has its pose, those between have no place
    assert (tmp_path / "k" / "poses.txt").exists()
    (tmp_path / "s" / "truth_left_tum.txt").write_text(rows.replace(".1 ", ".1000001 "))
    done = convert(open_recording(tmp_path / "s"), tmp_path / "t", "kitti")
    assert "truth_left_tum.txt" in done.notes[0]
    assert not (tmp_path / "t" / "poses.txt").exists()
    truth = open_recording(tmp_path / "t").truth()
    assert truth is not None
    assert truth.timestamps_ns[4:7].tolist() == [80_000_000, 100_000_100, 120_000_000]
    wanted = source.truth()
    assert wanted is not None
    np.testing.assert_allclose(truth.world_from_left, wanted.world_from_left, atol=1e-15)


def test_bad_pairs_are_left_out_and_told(tmp_path: Path) -> None:
    make_recording(tmp_path / "s", frames=4, width=160, height=96, truncated=(2,))
    done = call("convert", tmp_path / "s", "-o", tmp_path / "k", "--to", "kitti")
    assert done.exit_code == 0, done.stderr
    assert "Wrote 3 of 4 pairs" in done.stdout
    assert "000002.png" in done.stderr
    recording = open_recording(tmp_path / "k")
    truth = recording.truth()
    assert len(recording) == 3
    assert truth is not None
    np.testing.assert_array_equal(
        truth.timestamps_ns, [frame.timestamp_ns for frame in recording.frames()]
    )


def test_the_same_trajectory_from_the_converted_recording(
    synthetic_kitti: SyntheticRecording, tmp_path: Path
) -> None:
    done = call("convert", synthetic_kitti.path, "-o", tmp_path / "a.mcap", "--to", "mcap")
    assert done.exit_code == 0, done.stderr
    for source, out in ((synthetic_kitti.path, "k"), (tmp_path / "a.mcap", "m")):
        tracked = call("localize", source, "-o", tmp_path / out, "--no-report")
        assert tracked.exit_code == 0, tracked.stderr
    for name in (TUM, POSES):
        assert (tmp_path / "m" / name).read_bytes() == (tmp_path / "k" / name).read_bytes()
    # The truth is found by itself; a quaternion between costs a digit beyond those written.
    tables = [np.loadtxt(tmp_path / out / TRUTH) for out in ("k", "m")]
    np.testing.assert_allclose(tables[0], tables[1], atol=1e-8)
    assert call("evaluate", tmp_path / "m", "--no-report").exit_code == 0


@pytest.mark.parametrize("to", list(NAMES))
def test_what_exists_is_refused(to: str, small_kitti: SyntheticRecording, tmp_path: Path) -> None:
    out = tmp_path / NAMES[to]
    out.write_bytes(b"precious")
    done = call("convert", small_kitti.path, "-o", out, "--to", to)
    assert done.exit_code == 2
    assert f"{out.name} exists" in done.stderr
    assert out.read_bytes() == b"precious"


def test_misuse(small_kitti: SyntheticRecording, tmp_path: Path) -> None:
    assert call("convert", small_kitti.path, "-o", tmp_path / "a", "--to", "bag").exit_code == 2
    failed = call("convert", small_kitti.path, "-o", tmp_path / "a", "--to", "mcap")
    assert failed.exit_code == 2
    assert ".mcap" in failed.stderr
    assert call("convert", tmp_path, "-o", tmp_path / "a", "--to", "kitti").exit_code == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("to", list(NAMES))
@pytest.mark.parametrize("fault", [KeyboardInterrupt, InputError])
def test_an_interrupted_conversion_leaves_nothing(
    fault: type[BaseException], to: str, small_kitti: SyntheticRecording, tmp_path: Path
) -> None:
    def watch(frames):
        for number, frame in enumerate(frames):
            if number == 3:
                raise fault("stop")
            yield frame

    with pytest.raises(fault):
        convert(open_recording(small_kitti.path), tmp_path / NAMES[to], to, watch=watch)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("to", list(NAMES))
def test_a_full_disk_is_told(to: str, small_kitti: SyntheticRecording, tmp_path: Path) -> None:
    with file_size_limit(3000):
        done = call("convert", small_kitti.path, "-o", tmp_path / NAMES[to], "--to", to)
    assert done.exit_code == 2
    full = "(File too large|No space left on device); choose another place with -o"
    assert re.search(rf"cannot write .*: {full}", done.stderr)
    assert list(tmp_path.iterdir()) == []


def test_an_unfinished_recording_there_is_left_alone(
    small_kitti: SyntheticRecording, tmp_path: Path
) -> None:
    (tmp_path / "m.mcap.part").write_bytes(b"of a crash")
    with pytest.raises(InputError, match=r"m\.mcap\.part exists"):
        convert(open_recording(small_kitti.path), tmp_path / "m.mcap", "mcap")
    assert (tmp_path / "m.mcap.part").read_bytes() == b"of a crash"
    assert tuple(NAMES) == convert_module.TARGETS
