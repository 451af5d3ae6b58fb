# SPDX-License-Identifier: Apache-2.0
"""From a simulated drive to its evaluated trajectory, through the program."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from pilotage.cli.main import app
from pilotage.recordings import StereoFrame, open_recording
from pilotage.simulation import Simulation, load_world
from pilotage.simulation.pictures import Pictures, camera_rays

SMALL = ["--path", "straight-1m", "--width", "160", "--rate-hz", "4", "--seed", "3"]


def call(*arguments: object) -> Any:
    return CliRunner().invoke(app, list(map(str, arguments)))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("simulate") / "yard"
    done = call("simulate", "yard", "-o", out, "--ground", "gravel", *SMALL)
    assert done.exit_code == 0, done.output
    assert "Drove 1." in done.output
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
    from pilotage.behaviors.simulate import rover_rig

    rays = camera_rays(rover_rig(simulation, 160).left)
    pictures = Pictures(simulation)
    now_ns = simulation.time_ns
    seen = pictures.radiance("front_left", rays, first_ns=now_ns, last_ns=now_ns, channels=3)
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
    ],
)
def test_bad_input_is_refused(arguments: list[str], said: str, tmp_path: Path):
    out = tmp_path / "out"
    done = call("simulate", *arguments, "-o", out)
    assert done.exit_code == 2
    assert said in done.output
    assert not (out / "recording.mcap").exists()
