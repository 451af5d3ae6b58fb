# SPDX-License-Identifier: Apache-2.0
"""Cameras: the contract of all, kept by the simulated one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from camera_scenes import LEFT, RIGHT, WIDTH_PX, lenses, shots, small_world

from pilotage.cameras import Camera, Frame
from pilotage.cameras.simulated import SimulatedCamera
from pilotage.errors import DeviceError, InputError
from pilotage.robots import Velocity
from pilotage.robots.simulated import SimulatedRover
from pilotage.simulation import Fault, Simulation, World
from pilotage.simulation.pictures import Pictures
from pilotage.simulation.sensor import Sensor

MS = 1_000_000


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return small_world(tmp_path_factory.mktemp("cameras"))


def camera_of(simulation: Simulation, **options: object) -> SimulatedCamera:
    return SimulatedCamera(simulation, lenses(simulation), **options)  # type: ignore[arg-type]


def read(camera: Camera, *, timeout_s: float = 0.5) -> Frame:
    frame = camera.read(timeout_s=timeout_s)
    assert frame is not None
    return frame


def test_frames_come_one_by_one_and_are_newer_each_time(world: World):
    simulation = Simulation(world)
    camera = camera_of(simulation, rate_hz=10)
    assert camera.frames == (LEFT, RIGHT)
    with camera:
        frames = [read(camera) for _ in range(4)]
        stamps = [frame.timestamp_ns for frame in frames]
        assert stamps == sorted(set(stamps))
        assert np.diff(stamps) == pytest.approx(100 * MS, abs=MS)
        assert simulation.time_ns == 400 * MS
        for frame in frames:
            assert tuple(frame.pictures) == camera.frames
            for picture in frame.pictures.values():
                assert picture.dtype == np.uint8
                assert picture.shape == (120, WIDTH_PX)
            assert frame.exposure_s is not None
            assert 0 < frame.exposure_s < 0.05


def test_a_frame_that_does_not_come_in_time_is_none(world: World):
    simulation = Simulation(world)
    with camera_of(simulation, rate_hz=5) as camera:
        assert camera.latest(max_age_s=9.0) is None
        assert camera.read(timeout_s=0.05) is None
        assert simulation.time_ns == 50 * MS
        first = read(camera)
        assert camera.latest(max_age_s=0.1) is first
        assert camera.read(timeout_s=0.0) is None
        assert simulation.time_ns == 200 * MS


def test_the_newest_frame_is_there_whoever_lets_time_pass(world: World):
    simulation = Simulation(world)
    with camera_of(simulation, rate_hz=10) as camera, SimulatedRover(simulation) as robot:
        robot.send(Velocity(linear_m_s=0.3, angular_rad_s=0.0, lifetime_s=1.0))
        simulation.advance(950 * MS)
        newest = camera.latest(max_age_s=0.1)
        assert newest is not None
        assert 890 * MS < newest.timestamp_ns < 900 * MS
        assert camera.latest(max_age_s=0.04) is None
        assert read(camera) is newest  # it was not given by `read` so far
        assert simulation.time_ns == 950 * MS
        assert read(camera).timestamp_ns > 990 * MS


def test_a_camera_gives_what_the_recorder_writes(world: World):
    faults = [Fault("dirt", 0.0, 0.2)]
    simulation = Simulation(world, faults=faults)
    with camera_of(simulation, sensor=Sensor.realistic()) as camera:
        frames = [read(camera) for _ in range(2)]
    taken = shots(world, faults=faults, sensor=Sensor.realistic(), seed=world.seed, count=2)
    for frame, shot in zip(frames, taken, strict=True):
        assert frame.timestamp_ns == shot.stamps_ns[LEFT]
        for name in (LEFT, RIGHT):
            assert (frame.pictures[name] == shot.pictures[name]).all()


def test_a_lost_frame_does_not_come_and_a_late_one_comes_late(world: World):
    dropped = Fault("frames_dropped", 0.15, 1.0, duration_s=0.2, camera="left")
    delayed = Fault("frames_delayed", 0.45, 150.0)
    simulation = Simulation(world, faults=[dropped, delayed])
    with camera_of(simulation, rate_hz=10) as camera:
        times_ms = []
        for _ in range(4):
            frame = read(camera)
            times_ms.append((round(frame.timestamp_ns / MS), simulation.time_ns // MS))
    # Frames are ready at 100, then 400 ms; that of 500 ms comes, and is stamped, 150 ms later.
    assert [ready for _, ready in times_ms] == [100, 400, 650, 750]
    assert [stamp for stamp, _ in times_ms] == pytest.approx([99, 399, 649, 749], abs=1.5)


def test_silence_is_none_and_not_an_old_frame(world: World):
    simulation = Simulation(world, faults=[Fault("frames_dropped", 0.15, 1.0)])
    with camera_of(simulation) as camera:
        read(camera)
        assert camera.read(timeout_s=1.0) is None
        assert simulation.time_ns == 1100 * MS
        assert camera.latest(max_age_s=0.5) is None


def test_a_closed_camera_says_so_and_can_be_opened_again(world: World):
    simulation = Simulation(world)
    camera = camera_of(simulation)
    for _ in range(2):
        with pytest.raises(DeviceError, match="not open"):
            camera.read(timeout_s=0.1)
        with pytest.raises(DeviceError, match="not open"):
            camera.latest(max_age_s=1.0)
        with camera:
            read(camera)


def test_cameras_may_share_a_scene_and_see_colour(world: World):
    simulation = Simulation(world)
    lens = lenses(simulation)[LEFT]
    shared = Pictures(simulation)
    sensor = replace(Sensor(), pictures="colour")
    one, two = (
        SimulatedCamera(simulation, {name: lens}, name=name, sensor=sensor, pictures=shared)
        for name in ("down_left", LEFT)
    )
    with one, two:
        below, ahead = read(one), read(two)
        assert simulation.time_ns == 100 * MS  # the second frame was there already
    assert below.pictures["down_left"].shape == (120, WIDTH_PX, 3)
    assert (below.pictures["down_left"] != ahead.pictures[LEFT]).mean() > 0.5


def test_the_cameras_of_a_nao_are_cameras_too(world: World):
    lens = lenses(Simulation(world))[LEFT]
    simulation = Simulation(world, "nao", faults=[Fault("blind", 0.15, 1.0, camera="bottom")])
    shared = Pictures(simulation)
    top, bottom = (
        SimulatedCamera(simulation, {name: lens}, name=name, rate_hz=10, pictures=shared)
        for name in ("top", "bottom")
    )
    with top, bottom:
        assert read(top).pictures["top"].mean() > 40
        assert read(bottom).pictures["bottom"].mean() > 40
        assert read(top).pictures["top"].mean() > 40
        assert read(bottom).pictures["bottom"].mean() < 2


def test_wrong_cameras_are_refused(world: World, tmp_path: Path):
    simulation = Simulation(world)
    with pytest.raises(InputError, match="rate_hz = 2"):
        camera_of(simulation, rate_hz=2)
    lens = lenses(simulation)[LEFT]
    unknown = SimulatedCamera(simulation, {"rear": lens})
    with pytest.raises(InputError, match="camera 'rear' is unknown"), unknown:
        pass
    wall = small_world(tmp_path, wall_x_m=0.6)
    with pytest.raises(InputError, match="small: camera front_left is inside 'wall'"):
        Simulation(wall)
