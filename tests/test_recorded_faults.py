# SPDX-License-Identifier: Apache-2.0
"""Camera faults by name, each seen in what a recording holds of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from camera_scenes import LEFT, QUIET, RIGHT, differing, pairs_in, record, small_world

from pilotage import StereoRig
from pilotage.recordings import open_recording
from pilotage.recordings.mcap_index import read_index
from pilotage.simulation import Fault, World


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return small_world(tmp_path_factory.mktemp("faults"))


@pytest.fixture(scope="module")
def well(world: World, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording of a drive without a fault."""
    return record(world, tmp_path_factory.mktemp("well") / "well.mcap", sensor=QUIET)


def test_a_moved_camera_leaves_the_calibration_as_it_was(world: World, well: Path, tmp_path: Path):
    faults = [Fault("tilt_up", 0.0, 3.0), Fault("shift_right", 0.0, 20.0, camera="left")]
    moved = record(world, tmp_path / "moved.mcap", faults=faults, sensor=QUIET)
    assert same_rig(open_recording(moved).rig, open_recording(well).rig)
    assert differing(pairs_in(moved)[0].left, pairs_in(well)[0].left) > 0.2


def same_rig(a: StereoRig, b: StereoRig) -> bool:
    assert a.robot_from_left is not None
    assert b.robot_from_left is not None
    return bool(
        (a.right_from_left.matrix() == b.right_from_left.matrix()).all()
        and (a.robot_from_left.matrix() == b.robot_from_left.matrix()).all()
    )


def test_a_wrong_base_or_square_is_written_down(world: World, well: Path, tmp_path: Path):
    right = open_recording(well).rig
    for name, base, mount in (("wrong_base", 1.1, 1.0), ("wrong_square", 0.9, 0.9)):
        path = tmp_path / f"{name}.mcap"
        record(world, path, faults=[Fault(name, 0.0, base)], sensor=QUIET)
        wrong = open_recording(path).rig
        assert wrong.right_from_left.translation_m == pytest.approx(
            base * right.right_from_left.translation_m
        )
        assert wrong.robot_from_left is not None
        assert right.robot_from_left is not None
        assert wrong.robot_from_left.translation_m == pytest.approx(
            mount * right.robot_from_left.translation_m
        )
        assert differing(pairs_in(path)[-1].left, pairs_in(well)[-1].left) == 0


def test_swapped_pictures_are_recorded_on_the_other_side(world: World, well: Path, tmp_path: Path):
    path = tmp_path / "swapped.mcap"
    record(world, path, faults=[Fault("swapped", 1.0, 1.0)], sensor=QUIET)
    for was, swapped in zip(pairs_in(well), pairs_in(path), strict=True):
        is_swapped = was.timestamp_ns >= 1e9
        right, left = (was.left, was.right) if is_swapped else (was.right, was.left)
        assert (swapped.left == left).all()
        assert (swapped.right == right).all()


@pytest.mark.parametrize("lag", [2, -1])
def test_one_side_falls_frames_behind(world: World, well: Path, tmp_path: Path, lag: int):
    path = tmp_path / "behind.mcap"
    fault = Fault("out_of_step_frames", 1.0, lag, camera="front")
    record(world, path, faults=[fault], sensor=QUIET)
    before, after = pairs_in(well), pairs_in(path)
    first = next(i for i, pair in enumerate(before) if pair.timestamp_ns >= 1e9)
    for index in range(first, len(before)):
        late_left, late_right = max(0, -lag), max(0, lag)
        assert (after[index].left == before[index - late_left].left).all()
        assert (after[index].right == before[index - late_right].right).all()
        assert after[index].timestamp_ns == before[index].timestamp_ns


def stamps_of(path: Path, camera: str) -> list[int]:
    topics = read_index(path)
    found = [t for name, t in topics.items() if name.startswith(f"/{camera}/image_raw")]
    return list(found[0].times_ns)


def test_dropped_frames_are_missing_in_the_recording(world: World, well: Path, tmp_path: Path):
    path = tmp_path / "dropped.mcap"
    fault = Fault("frames_dropped", 0.5, 1.0, duration_s=0.6, camera="left")
    record(world, path, faults=[fault], sensor=QUIET)
    everything = stamps_of(well, LEFT)
    left = [t for t in everything if not 0.5e9 <= t < 1.1e9]
    assert stamps_of(path, LEFT) == left
    assert len(everything) - len(left) == 3
    assert stamps_of(path, RIGHT) == everything
    # The truth goes on.
    truth = open_recording(path).truth()
    assert truth is not None
    assert set(everything) <= set(truth.timestamps_ns.tolist())


def test_delayed_frames_are_stamped_late(world: World, well: Path, tmp_path: Path):
    path = tmp_path / "delayed.mcap"
    record(world, path, faults=[Fault("frames_delayed", 1.0, 80.0)], sensor=QUIET)
    late = np.array(stamps_of(path, LEFT)) - stamps_of(well, LEFT)
    assert set(late.tolist()) == {0, 80_000_000}
    truths = [open_recording(p).truth() for p in (well, path)]
    assert truths[0] is not None
    assert truths[1] is not None
    assert (truths[0].timestamps_ns == truths[1].timestamps_ns).all()
