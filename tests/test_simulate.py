# SPDX-License-Identifier: Apache-2.0
"""From a simulated drive to its evaluated trajectory, through the program."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from program import call

from pilotage.behaviors.recorder import Moment
from pilotage.cli import live
from pilotage.cli.live import LineView
from pilotage.recordings import StereoFrame, open_recording, read_joints, read_odometry
from pilotage.recordings.mcap import McapRecording
from pilotage.simulation import Simulation, load_world, robot_model
from pilotage.simulation.pictures import Pictures, camera_rays

SMALL = ["--path", "straight-1m", "--width", "160", "--rate-hz", "4", "--seed", "3"]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("simulate") / "yard"
    done = call("simulate", "yard", "-o", out, "--ground", "gravel", *SMALL)
    assert done.exit_code == 0, done.output
    assert "Went 1." in done.output
    return out


def test_a_simulated_drive_is_localized(recorded: Path, tmp_path: Path):
    out = tmp_path / "out"
    done = call("localize", recorded, "-o", out, "--no-report")
    assert done.exit_code == 0, done.output
    assert call("evaluate", out).exit_code == 0
    evaluation = json.loads((out / "evaluation.json").read_text())
    assert evaluation["truth_length_m"] == pytest.approx(1.0, abs=0.1)
    # Pictures of 160x120: a pixel is a third of a degree.
    assert evaluation["ate_rmse_m"] < 0.02
    summary = json.loads((out / "summary.json").read_text())
    assert summary["lost"] == 0
    assert summary["body"] == "robot"


def test_every_pair_is_recorded_and_chosen_by_name(recorded: Path, tmp_path: Path):
    front, down = (open_recording(recorded, pair=pair) for pair in ("front", "down"))
    assert isinstance(front, McapRecording)
    assert front.pairs == ("down", "front")
    assert len(front) == len(down)
    for recording, looks in ((front, [0.985, 0, -0.174]), (down, [0, 0, -1])):
        assert recording.rig.robot_from_left is not None
        axis = recording.rig.robot_from_left.matrix()[:3, 2]
        np.testing.assert_allclose(axis, looks, atol=1e-3)
        np.testing.assert_allclose(recording.rig.right_from_left.translation_m[0], -0.058)
    # The default looks ahead; truth is of the chosen pair's left camera.
    first = next(iter(open_recording(recorded).frames()))
    again = next(iter(front.frames()))
    assert isinstance(first, StereoFrame)
    assert isinstance(again, StereoFrame)
    np.testing.assert_array_equal(first.left, again.left)
    truths = front.truth(), down.truth()
    assert truths[0] is not None
    assert truths[1] is not None
    apart = truths[0].world_from_left[0, :3, 3] - truths[1].world_from_left[0, :3, 3]
    np.testing.assert_allclose(np.abs(apart[2]), 0.1, atol=0.01)
    done = call("localize", recorded, "--pair", "down", "-o", tmp_path / "out", "--no-report")
    assert "of " in done.output
    wrong = call("localize", recorded, "--pair", "up", "-o", tmp_path / "up")
    assert wrong.exit_code == 2
    assert "there are: down, front" in " ".join(wrong.output.split())


def test_a_run_of_one_pair_is_set_against_the_truth_of_the_recording(
    recorded: Path, tmp_path: Path
):
    ends = []
    for pair in ("front", "down"):
        out = tmp_path / pair
        call("localize", recorded, "--pair", pair, "-o", out, "--no-report")
        truth = [] if pair == "front" else ["--truth", recorded]
        assert call("evaluate", out, *truth, "--no-report").exit_code == 0
        rows = np.loadtxt(out / "truth_tum.txt", usecols=(1, 2, 3))
        ends.append(rows[0])
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-3)  # both of the robot


def test_a_chosen_pair_goes_over_with_its_name(recorded: Path, tmp_path: Path):
    file = tmp_path / "down.mcap"
    assert call("convert", recorded, "--pair", "down", "-o", file, "--to", "mcap").exit_code == 0
    there, here = open_recording(file), open_recording(recorded, pair="down")
    assert isinstance(there, McapRecording)
    assert there.pairs == ("down",)
    for one, other in zip(there.frames(), here.frames(), strict=True):
        assert isinstance(one, StereoFrame)
        assert isinstance(other, StereoFrame)
        np.testing.assert_array_equal(one.right, other.right)


def test_only_what_is_asked_for_is_recorded(tmp_path: Path):
    out = tmp_path / "front"
    done = call("simulate", "yard", "-o", out, "--pairs", "front", *SMALL)
    assert done.exit_code == 0, done.output
    recording = open_recording(out)
    assert isinstance(recording, McapRecording)
    assert recording.pairs == ("front",)


def test_odometry_and_truth_are_dense_and_of_the_same_drive(recorded: Path):
    odometry, truth = read_odometry(recorded), open_recording(recorded).truth()
    assert odometry is not None
    assert truth is not None
    assert np.diff(odometry.timestamps_ns).max() <= 20_000_000
    assert np.diff(truth.timestamps_ns).max() <= 20_000_000
    ends = odometry.odom_from_robot[-1, :2, 3], truth.world_from_left[-1, :2, 3]
    assert np.linalg.norm(ends[0]) == pytest.approx(1.0, abs=0.1)
    assert np.linalg.norm(ends[0] + [0.57, 0.03] - ends[1]) < 0.1
    # It knows how fast it goes, and that it stands at last.
    assert odometry.twists[:, 0].max() == pytest.approx(0.4, abs=0.05)
    assert odometry.twists[-1, 0] == pytest.approx(0, abs=1e-3)
    assert read_joints(recorded) is None


def test_a_rate_that_the_steps_of_the_drive_do_not_divide(tmp_path: Path):
    out = tmp_path / "fast"
    arguments = ["--path", "straight-1m", "--width", "160", "--rate-hz", "56", "--pairs", "front"]
    done = call("simulate", "yard", "-o", out, *arguments, "--speed", "0.8")
    assert done.exit_code == 0, done.output
    recording = open_recording(out)
    times_ns = [frame.timestamp_ns for frame in recording.frames()]
    apart_ns = np.diff(times_ns)
    # Stamps are of the exposure's middle, which moves a little as it is regulated.
    assert apart_ns.mean() == pytest.approx(1e9 / 56, rel=1e-3)
    assert np.abs(apart_ns - 1e9 / 56).max() < 2e6
    truth = recording.truth()
    assert truth is not None
    assert set(times_ns) <= set(truth.timestamps_ns.tolist())


def test_the_same_arguments_give_the_same_bytes(recorded: Path, tmp_path: Path):
    again = tmp_path / "again"
    assert call("simulate", "yard", "-o", again, "--ground", "gravel", *SMALL).exit_code == 0
    assert (again / "recording.mcap").read_bytes() == (recorded / "recording.mcap").read_bytes()


def test_pictures_are_well_exposed_and_change(recorded: Path):
    frames = [f for f in open_recording(recorded).frames() if isinstance(f, StereoFrame)]
    means = [float(frame.left.mean()) for frame in frames]
    assert 80 < np.mean(means) < 140
    assert np.mean(frames[0].left != frames[-1].left) > 0.5
    assert all(frame.left.std() > 10 for frame in frames)


@pytest.mark.parametrize("world", ["yard", "corridor", "office"])
def test_every_world_can_be_seen(world: str):
    simulation = Simulation(load_world(world, seed=1), "rover")
    rays = camera_rays(robot_model("rover").stereo_rig(simulation, "front", 160).left)
    pictures = Pictures(simulation)
    seen = pictures.radiance(rays, simulation.camera_pose("front_left"), channels=3)
    assert seen.shape == (120, 160, 3)
    assert np.isfinite(seen).all()
    assert seen.min() > 0
    assert seen.std() > 0.03


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["meadow"], "'meadow'"),
        (["yard", "--ground", "lava"], "'lava'"),
        (["yard", "--path", "round-3m"], "round"),
        (["yard", "--width", "100"], "100 px"),
        (["yard", "--rate-hz", "0"], "0 Hz"),
        (["yard", "--set", "objects"], "KEY=VALUE"),
        (["yard", "--robot", "tank"], "use one of nao, rover"),
        (["yard", "--pairs", "front,up"], "'up' is unknown"),
        (["yard", "--pairs", ","], "use one of down, front"),
        (["yard", "--robot", "nao", "--pairs", "front"], "there are none here"),
        (["yard", "--crouch"], "--robot nao"),
        (["yard", "--robot", "nao", "--looks", "left"], "'left'"),
        (["yard", "--robot", "nao", "--looks", "0:60"], "0:29.5"),
        (["yard", "--robot", "nao", "--looks", ","], "no look"),
        (["yard", "--robot", "nao", "--stop-every", "0"], "0 steps"),
        (["yard", "--robot", "nao", "--walking-hz", "99"], "99 pictures a second"),
        (["office", "--path", "closed-50m"], "paths that fit: closed-"),
        (["corridor", "--path", "closed-10m"], "straight-"),
    ],
)
def test_bad_input_is_refused(arguments: list[str], said: str, tmp_path: Path):
    out = tmp_path / "out"
    done = call("simulate", *arguments, "-o", out)
    assert done.exit_code == 2
    assert said in " ".join(done.output.split())
    assert not (out / "recording.mcap").exists()


def test_what_an_interrupt_left_is_recovered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def interrupt(moment: Moment) -> None:
        if moment.shots == 6:
            raise KeyboardInterrupt

    view = LineView("yard", "pairs")
    monkeypatch.setattr(view, "on_moment", interrupt)
    monkeypatch.setattr(live, "make_drive_view", lambda *_: view)
    done = call("simulate", "yard", "-o", tmp_path / "cut", *SMALL)
    assert done.exit_code == 1
    part = tmp_path / "cut" / "recording.mcap.part"
    assert f"pilotage recover {part}" in " ".join(done.output.split())
    assert call("recover", part).exit_code == 0
    for pair in ("front", "down"):
        assert len(open_recording(tmp_path / "cut", pair=pair)) == 6
    assert read_odometry(tmp_path / "cut") is not None
