# SPDX-License-Identifier: Apache-2.0
"""The Nao's recorded walk: stops, looks and crouches, and what reading gives back of it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from program import call, said

from pilotage.calibration.nao_head import head_from_camera, neck_from_head, torso_from_neck
from pilotage.errors import InputError
from pilotage.recordings import (
    SinglePicture,
    open_pictures,
    open_recording,
    read_joints,
    read_odometry,
)
from pilotage.simulation import Simulation, load_world
from pilotage.simulation.nao import Nao

YAWS_DEG = [33.5, 0.0, -33.5]
WALK = ["--robot", "nao", "--path", "straight-1m", "--width", "160", "--seed", "2"]


def pictures_of(path: Path) -> list[SinglePicture]:
    pictures = list(open_pictures(path).pictures())
    assert all(isinstance(picture, SinglePicture) for picture in pictures)
    return [picture for picture in pictures if isinstance(picture, SinglePicture)]


@pytest.fixture(scope="module")
def walked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("walk") / "office"
    done = call("simulate", "office", "-o", out, "--stop-every", "11", "--crouch", *WALK)
    assert done.exit_code == 0, done.output
    assert "3 stops, 18 looks" in done.output
    return out


def test_each_stop_has_every_look_standing_and_crouching(walked: Path):
    pictures = pictures_of(walked)
    assert len(open_pictures(walked)) == len(pictures) == 3 * 2 * 3 * 2
    assert [p.camera for p in pictures[:4]] == ["bottom", "top"] * 2
    yaws = [math.degrees(p.joints_rad["HeadYaw"]) for p in pictures if p.camera == "top"]
    # By the encoders: half of 0.2 degrees of play, half a step of 0.09, and noise.
    np.testing.assert_allclose(yaws, YAWS_DEG * 6, atol=0.3)
    assert not any(p.is_moving for p in pictures)
    heights = []
    for picture in pictures:
        assert picture.robot_from_camera is not None
        assert picture.torso_from_camera is not None
        robot_from_torso = picture.robot_from_camera @ picture.torso_from_camera.inverse()
        heights.append(round(float(robot_from_torso.translation_m[2]), 6))
    stop = [heights[0]] * 6 + [round(heights[0] - 0.11, 6)] * 6
    assert heights == stop * 3


def test_cameras_are_truly_where_an_exact_head_says(tmp_path: Path):
    walked = tmp_path / "exact"
    few = ["--stop-every", "30", "--encoders", "0"]
    assert call("simulate", "office", "-o", walked, *few, *WALK).exit_code == 0
    recording = open_pictures(walked)
    torso = recording.truth("torso")
    assert torso is not None
    for picture in pictures_of(walked):
        camera = recording.truth(picture.camera)
        assert camera is not None
        at = int(np.searchsorted(camera.timestamps_ns, picture.timestamp_ns))
        assert camera.timestamps_ns[at] == torso.timestamps_ns[at] == picture.timestamp_ns
        assert picture.torso_from_camera is not None
        world_from_camera = torso.poses[at] @ picture.torso_from_camera.matrix()
        np.testing.assert_allclose(world_from_camera, camera.poses[at], atol=1e-9)
    assert recording.truth("tail") is None


def test_steps_err_and_their_odometry_does_not_know(walked: Path):
    odometry, truth = read_odometry(walked), open_pictures(walked).truth("robot")
    assert odometry is not None
    assert truth is not None
    believed, true = odometry.odom_from_robot[-1, :2, 3], truth.poses[-1, :2, 3]
    assert 0.005 < np.linalg.norm(believed - true) < 0.2
    pictures = pictures_of(walked)
    first, last = pictures[0].odom_from_robot, pictures[-1].odom_from_robot
    assert first is not None
    assert last is not None
    np.testing.assert_allclose(first.translation_m, 0)
    np.testing.assert_allclose(last.translation_m[:2], believed, atol=1e-9)
    # A stop is not left until it is looked at.
    stops = {tuple(p.odom_from_robot.translation_m.tolist()) for p in pictures if p.odom_from_robot}
    assert len(stops) == 3


def test_joints_come_back_as_they_were(walked: Path):
    joints = read_joints(walked)
    assert joints is not None
    assert joints.names == ("HeadYaw", "HeadPitch")
    assert np.degrees(joints.of("HeadYaw")).max() == pytest.approx(33.5, abs=0.3)
    assert np.abs(np.degrees(joints.of("HeadPitch"))).max() < 0.2  # never moved: noise alone


def test_pictures_on_the_way_shake(tmp_path: Path):
    out = tmp_path / "yard"
    arguments = ["--looks", "0:10", "--walking-hz", "2", "--stop-every", "100"]
    done = call("simulate", "yard", "-o", out, *arguments, *WALK)
    assert done.exit_code == 0, done.output
    recording = open_pictures(out)
    torso, robot = recording.truth("torso"), recording.truth("robot")
    assert torso is not None
    assert robot is not None
    tilts: dict[bool, list[float]] = {True: [], False: []}
    for picture in pictures_of(out):
        at = int(np.searchsorted(torso.timestamps_ns, picture.timestamp_ns))
        robot_from_torso = np.linalg.inv(robot.poses[at]) @ torso.poses[at]
        assert picture.is_moving is not None
        tilts[picture.is_moving].append(math.acos(min(1.0, robot_from_torso[2, 2])))
        if not picture.is_moving:
            assert picture.joints_rad["HeadPitch"] == pytest.approx(math.radians(10), abs=0.005)
    assert len(tilts[True]) > 20
    assert max(tilts[True]) > math.radians(0.5)
    assert max(tilts[False]) < 1e-6
    assert len(tilts[False]) == 4


def test_localize_says_what_is_missing(walked: Path, tmp_path: Path):
    done = call("localize", walked, "-o", tmp_path / "out")
    assert done.exit_code == 2
    for words in ("0 stereo pairs", "/bottom, /top", "open_pictures"):
        assert words in said(done)


def test_the_same_arguments_give_the_same_bytes(walked: Path, tmp_path: Path):
    again = tmp_path / "again"
    call("simulate", "office", "-o", again, "--stop-every", "11", "--crouch", *WALK)
    assert (again / "recording.mcap").read_bytes() == (walked / "recording.mcap").read_bytes()


@pytest.mark.parametrize("name", ["top", "bottom"])
def test_the_heads_chain_is_the_bodys(name: str):
    simulation = Simulation(load_world("yard", seed=1), "nao")
    assert isinstance(simulation.body, Nao)
    simulation.body.turn_head(0.7, -0.3)
    simulation.advance(2_000_000_000)
    torso_from_camera = torso_from_neck(0.7) @ neck_from_head(-0.3) @ head_from_camera(name)
    world_from_camera = simulation.part_pose("torso") @ torso_from_camera
    np.testing.assert_allclose(
        world_from_camera.matrix(), simulation.camera_pose(name).matrix(), atol=1e-9
    )
    with pytest.raises(InputError, match=r"'tail' is unknown; .*torso"):
        simulation.part_pose("tail")


def test_stereo_recordings_hold_single_pictures_too(tmp_path: Path):
    out = tmp_path / "rover"
    arguments = ["--path", "straight-1m", "--width", "160", "--rate-hz", "1"]
    assert call("simulate", "office", "-o", out, "--set", "person=none", *arguments).exit_code == 0
    recording = open_pictures(out)
    assert sorted(recording.cameras) == ["down_left", "down_right", "front_left", "front_right"]
    assert len(recording) == 4 * len(open_recording(out))
    first = pictures_of(out)[0]
    assert first.robot_from_camera is not None
    np.testing.assert_allclose(first.robot_from_camera.translation_m, [0.56, 0.029, 0.5], atol=0.01)
    assert first.torso_from_camera is None
    assert first.joints_rad == {}
