# SPDX-License-Identifier: Apache-2.0
"""The encoders of the Nao's head: what they tell, what is true, and what a recording holds."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from program import call, said

from pilotage.calibration.nao_head import HeadAngles
from pilotage.errors import InputError
from pilotage.recordings import SinglePicture, open_pictures, read_joints
from pilotage.simulation import Encoders, Simulation, load_world
from pilotage.simulation.nao import Nao

STEP_RAD = 2 * math.pi / 4096
WALK = ["--robot", "nao", "--path", "straight-1m", "--width", "160", "--seed", "2"]
STOPS = ["--stop-every", "40", "--looks", "20,-20:5", "--set", "person=none"]
STILL = np.zeros(2)


def told(
    encoders: Encoders, head: HeadAngles, way: np.ndarray = STILL, *, count: int = 400
) -> np.ndarray:
    """Return (count, 2) readings of the same angles."""
    return np.array([encoders.read(head, way, seed=[5, number]) for number in range(count)])


def test_readings_are_steps_of_twelve_bits():
    readings = told(Encoders(), HeadAngles(0.3, -0.2))
    steps = readings / STEP_RAD
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    np.testing.assert_allclose(readings.mean(axis=0), [0.3, -0.2], atol=STEP_RAD / 2)
    assert (readings.std(axis=0) > 0).all()


def test_noise_is_of_the_size_told_and_seeded():
    encoders = Encoders(resolution_rad=0.0, noise_rad=0.002, play_rad=0.0)
    readings = told(encoders, HeadAngles(0.1, 0.0))
    np.testing.assert_allclose(readings.std(axis=0), 0.002, rtol=0.1)
    np.testing.assert_array_equal(readings, told(encoders, HeadAngles(0.1, 0.0)))


def test_zeros_are_exact_and_ranges_are_kept():
    exact = Encoders().scaled(0)
    assert exact.read(HeadAngles(0.123, -0.45), np.ones(2), seed=[1, 2]) == (0.123, -0.45)
    with pytest.raises(InputError, match="play_rad = -1"):
        Encoders(play_rad=-1.0)


def test_play_shows_from_which_side_the_head_came():
    encoders = Encoders(resolution_rad=0.0, noise_rad=0.0, play_rad=0.01)
    simulation = Simulation(load_world("yard", seed=1), Nao(encoders))
    nao = simulation.body
    assert isinstance(nao, Nao)
    assert nao.told_head == HeadAngles(0.0, 0.0)
    readings = []
    for yaw_rad in (0.5, 0.2, -0.1, 0.2):
        nao.turn_head(yaw_rad, 0.0)
        simulation.advance(simulation.time_ns + 600_000_000)
        assert nao.head.yaw_rad == yaw_rad
        readings.append(nao.told_head)
    offsets = np.subtract([reading.yaw_rad for reading in readings], (0.5, 0.2, -0.1, 0.2))
    np.testing.assert_allclose(offsets, [0.005, -0.005, -0.005, 0.005])
    assert [reading.pitch_rad for reading in readings] == [0.0] * 4


def walk(out: Path, *arguments: object) -> Path:
    done = call("simulate", "office", "-o", out, *STOPS, *WALK, *arguments)
    assert done.exit_code == 0, done.output
    return out


def test_recorded_angles_err_and_the_truth_does_not(tmp_path: Path):
    erring, exact = walk(tmp_path / "erring"), walk(tmp_path / "exact", "--encoders", "0")
    recordings = [open_pictures(path) for path in (erring, exact)]
    for frame in ("robot", "torso", "top", "bottom"):
        truths = [recording.truth(frame) for recording in recordings]
        assert truths[0] is not None
        assert truths[1] is not None
        np.testing.assert_array_equal(truths[0].timestamps_ns, truths[1].timestamps_ns)
        np.testing.assert_array_equal(truths[0].poses, truths[1].poses)
    joints = [read_joints(path) for path in (erring, exact)]
    assert joints[0] is not None
    assert joints[1] is not None
    apart = np.abs(joints[0].of("HeadYaw") - joints[1].of("HeadYaw"))
    assert 0.0005 < apart.max() < 0.006
    # Pictures are the same; the frames they hang on are those of the encoders.
    for one, other in zip(*(recording.pictures() for recording in recordings), strict=True):
        assert isinstance(one, SinglePicture)
        assert isinstance(other, SinglePicture)
        np.testing.assert_array_equal(one.picture, other.picture)
        assert one.torso_from_camera is not None
        assert other.torso_from_camera is not None
        between = (one.torso_from_camera.inverse() @ other.torso_from_camera).matrix()
        cosine = (np.trace(between[:3, :3]) - 1) / 2
        yaw_rad = one.joints_rad["HeadYaw"] - other.joints_rad["HeadYaw"]
        pitch_rad = one.joints_rad["HeadPitch"] - other.joints_rad["HeadPitch"]
        turned_rad = math.acos(min(1.0, cosine))
        assert turned_rad == pytest.approx(math.hypot(yaw_rad, pitch_rad), rel=0.1, abs=1e-7)


def test_encoders_are_refused_where_they_cannot_be(tmp_path: Path):
    few = ["--path", "straight-1m", "--width", "160", "-o", tmp_path / "out"]
    done = call("simulate", "yard", "--encoders", "0", *few)
    assert done.exit_code == 2
    assert "--encoders is for a robot with a head" in said(done)
    done = call("simulate", "yard", "--robot", "nao", "--encoders", "-1", *few)
    assert done.exit_code == 2
    assert "resolution_rad" in said(done)
