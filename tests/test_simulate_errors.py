# SPDX-License-Identifier: Apache-2.0
"""What goes wrong around a simulated drive: cameras in walls, full disks, names that are none."""

from __future__ import annotations

import math
import os
import re
import resource
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from camera_scenes import RIGHT, WORLD, record, shots, small_world
from program import call, said

from pilotage.errors import InputError, RunError
from pilotage.simulation import Fault, Motion, Simulation, World, load_world
from pilotage.simulation.sight import height_below_m
from pilotage.simulation.solids import Solids

SMALL = ["--path", "straight-1m", "--width", "160", "--rate-hz", "4"]
SOLID = 'type="box" size="0.1 4 1.5"'


def with_wall(folder: Path, x_m: float, attributes: str) -> Path:
    """Return the file of the small world with its wall there, of that shape."""
    file = folder / "small.xml"
    file.write_text(WORLD.format(wall_x_m=x_m).replace(SOLID, attributes))
    return file


@pytest.mark.parametrize(
    ("x_m", "attributes", "message"),
    [
        (0.6, SOLID, "small: camera front_left is inside 'wall' at x 0.57"),
        (0.0, 'type="box" size="3 3 3"', "camera front_left is inside 'wall'"),
        (0.0, SOLID, "does not fit at the start"),
        (0.0, 'type="plane" euler="0 10 0" size="1 1 1"', "camera front_left is inside 'wall'"),
    ],
)
def test_no_camera_and_no_robot_starts_inside_something(
    tmp_path: Path, x_m: float, attributes: str, message: str
):
    world = with_wall(tmp_path, x_m, attributes)
    done = call("simulate", world, "-o", tmp_path / "out", *SMALL)
    assert done.exit_code == 2
    assert "wall" in done.output or message in done.output
    assert not list(tmp_path.glob("out/*"))
    with pytest.raises(InputError, match=re.escape(message)):
        Simulation(load_world(world))


@pytest.mark.parametrize(
    ("note", "message"),
    [
        ("asphalt seed=abc", "surface:floor: seed = 'abc': must be a whole number from 0"),
        ("asphalt seed", "surface:floor: seed = '': must be a whole number"),
        ("asphalt sed=7", "option 'sed' is unknown; did you mean 'seed'?"),
        ("asphalt scale=0", "surface:floor: scale = '0': must be a number from 0.01 to 100"),
        ("asphalt scale=nan", "surface:floor: scale = 'nan'"),
        ("asphlt", "surface 'asphlt' is unknown; did you mean 'asphalt'?"),
    ],
)
def test_a_surface_that_cannot_be_is_misuse(tmp_path: Path, note: str, message: str):
    world = tmp_path / "small.xml"
    world.write_text(WORLD.format(wall_x_m=5).replace("gravel seed=7 scale=4", note))
    done = call("simulate", world, "-o", tmp_path / "out", *SMALL)
    assert done.exit_code == 2
    assert message in said(done)
    assert not (tmp_path / "out").exists()


def test_a_surface_of_no_material_is_misuse(tmp_path: Path):
    world = tmp_path / "small.xml"
    world.write_text(WORLD.format(wall_x_m=5).replace("surface:wall", "surface:wal"))
    done = call("simulate", world, "-o", tmp_path / "out", *SMALL)
    assert done.exit_code == 2
    assert "text 'surface:wal' names no material" in said(done)


def test_what_a_camera_is_inside_has_a_name_though_it_has_none_itself(tmp_path: Path):
    box = '<geom type="box" size="0.1 1 1.5"/>'
    world = with_wall(tmp_path, 5, SOLID)
    text = world.read_text()
    for thing, name in (
        (f'<body name="fence" pos="0.6 0 0.5">{box}</body>', "a geom of body 'fence'"),
        (box.replace("/>", ' pos="0.6 0 0.5" material="red"/>'), "a geom of material 'red'"),
    ):
        world.write_text(text.replace("</worldbody>", thing + "</worldbody>"))
        with pytest.raises(InputError, match=f"front_left is inside {name}"):
            Simulation(load_world(world))


def test_a_camera_of_the_world_does_not_stand_in_for_the_robots(tmp_path: Path):
    world = small_world(tmp_path)
    poses = []
    for cameras in ("", '<camera name="front_left" pos="1 2 3"/><camera name="eye"/>'):
        text = world.mjcf.replace("</worldbody>", cameras + "</worldbody>")
        simulation = Simulation(World("small", 4, text))
        poses.append(simulation.camera_pose("front_left").matrix())
        assert simulation.camera_names.count("front_left") == 1
    np.testing.assert_array_equal(*poses)
    assert simulation.camera_pose("eye").translation_m == pytest.approx([0, 0, 0])


def test_what_was_never_finished_is_named_with_its_remedy(tmp_path: Path):
    (tmp_path / "recording.mcap.part").write_bytes(b"begun")
    done = call("localize", tmp_path, "-o", tmp_path / "out")
    assert done.exit_code == 2
    assert "was never finished; `pilotage recover` makes it whole" in said(done)


def test_no_folder_is_left_where_nothing_was_recorded(tmp_path: Path):
    for wrong in (["--width", "7"], ["--rate-hz", "1000"]):
        done = call("simulate", "yard", "-o", tmp_path / "new", "--path", "straight-1m", *wrong)
        assert done.exit_code == 2
        assert not (tmp_path / "new").exists()
    mine = tmp_path / "mine"
    mine.mkdir()
    assert call("simulate", "yard", "-o", mine, "--width", "7").exit_code == 2
    assert mine.is_dir()


def test_a_camera_that_enters_a_wall_on_its_way_ends_the_drive(tmp_path: Path):
    # What is not solid does not stop the rover.
    world = with_wall(tmp_path, 1.3, SOLID + ' contype="0" conaffinity="0"')
    out = tmp_path / "out"
    done = call("simulate", world, "-o", out, *SMALL)
    assert done.exit_code == 2
    assert "camera front_left is inside 'wall' at x 1.2" in done.output
    assert "s from the start" in done.output
    assert [file.name for file in out.iterdir()] == ["recording.mcap.part"]


def test_a_fault_may_push_a_camera_into_something(tmp_path: Path):
    world = small_world(tmp_path)
    box = 'type="box" size="0.05 1 0.02" pos="0.7 0 0.55" contype="0" conaffinity="0"'
    file = tmp_path / "shelf.xml"
    file.write_text(world.mjcf.replace("</worldbody>", f'<geom name="shelf" {box}/></worldbody>'))
    shelf = load_world(file)
    shots(shelf)
    forward, down = (
        Fault(f"shift_{way}", 0.15, mm) for way, mm in (("forward", 130), ("down", 25))
    )
    with pytest.raises(InputError, match=r"front_left is inside 'shelf' at x 0\.69.*0\.20 s"):
        shots(shelf, faults=[forward, down])


GEOMS = """
<mujoco>
 <asset>
  <mesh name="m" vertex="0 0 0  2 0 0  0 2 0  0 0 2"/>
 </asset>
 <worldbody>
  <geom name="thing" {} euler="20 -30 40" pos="0.1 0.2 -0.1"/>
  <geom name="unseen" type="sphere" size="50" rgba="0 0 0 0" contype="0" conaffinity="0"/>
  <body mocap="true" name="walker"><geom type="sphere" size="50"/></body>
 </worldbody>
</mujoco>
"""


@pytest.mark.parametrize(
    "attributes",
    [
        'type="sphere" size="0.6"',
        'type="capsule" size="0.3 0.5"',
        'type="ellipsoid" size="0.9 0.5 0.3"',
        'type="cylinder" size="0.5 0.4"',
        'type="box" size="0.7 0.4 0.3"',
        'type="mesh" mesh="m"',
    ],
)
def test_a_point_is_inside_when_every_way_out_meets_the_surface(attributes: str):
    model = mujoco.MjModel.from_xml_string(GEOMS.format(attributes))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    solids = Solids(model, data)
    thing = model.geom("thing").id
    model.geom_group[:] = 5
    model.geom_group[thing] = 0
    shown = np.array([1, 0, 0, 0, 0, 0], np.uint8)
    random = np.random.default_rng(1)
    directions = random.normal(size=(40, 3))
    inside = 0
    for point in random.uniform(-1.2, 1.2, (200, 3)):
        # All are convex: from inside every ray hits the surface, from outside some do not.
        hits = [
            mujoco.mj_ray(model, data, point, way, shown, 1, -1, np.full(1, -1, np.int32)) >= 0
            for way in directions / np.linalg.norm(directions, axis=1)[:, None]
        ]
        found = solids.around(point)
        assert (found == "'thing'") == all(hits)
        inside += found is not None
    assert 3 < inside < 150


def test_a_point_is_below_a_height_field_or_above(tmp_path: Path):
    relief = load_world("yard", seed=2, options={"relief_m": 0.4, "objects": 0})
    simulation = Simulation(relief)
    random = np.random.default_rng(1)
    for x, y in random.uniform(-8, 8, (100, 2)):
        ground = height_below_m(simulation.model, simulation.data, np.array([x, y, 3.0]))
        assert ground is not None
        assert simulation.solids.around(np.array([x, y, ground - 0.01])) == "'ground'"
        assert simulation.solids.around(np.array([x, y, ground + 0.01])) in {None, "'mark_a'"}


def test_a_pose_that_is_none_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo logs the warning into the working folder
    world = small_world(tmp_path)
    dog = '<body name="dog" mocap="true" pos="9 9 0"><geom size="0.2"/></body></worldbody>'
    file = tmp_path / "dog.xml"
    file.write_text(world.mjcf.replace("</worldbody>", dog))
    simulation = Simulation(load_world(file))
    simulation.data.mocap_pos[0] = math.nan
    with pytest.raises(RunError, match=r"dog: the physics broke down, 0\.1"):
        simulation.advance(100_000_000)
    for body in ("rover", "nao"):
        with pytest.raises(InputError, match="must be numbers"):
            Simulation(world, body).body.command(Motion(math.nan, 0, 0), 10**12)


def test_a_disk_that_is_full_leaves_nothing_that_looks_whole(tmp_path: Path):
    world, out = small_world(tmp_path), tmp_path / "out"

    def fill_the_disk() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))

    done = subprocess.run(
        [sys.executable, "-m", "pilotage.cli.main", "simulate", str(world.path), "-o", out, *SMALL],
        capture_output=True,
        text=True,
        preexec_fn=fill_the_disk,
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},
        check=False,
    )
    assert done.returncode == 2, done.stderr
    assert "choose another place" in " ".join(done.stderr.split())
    assert f"cannot write {out / 'recording.mcap.part'}" in " ".join(done.stderr.split())
    assert [file.name for file in out.iterdir()] == ["recording.mcap.part"]
    refused = call("localize", out, "-o", tmp_path / "results")
    assert refused.exit_code == 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("faults:\n- {name: blurr, onset_s: 0, size: 1}\n", "did you mean 'blur'"),
        ("faults:\n- {name: blur, onset_s: 0, size: 99}\n", "size = 99"),
        ("faults:\n- {name: blur, onset_s: 0, size: 9, camera: rear}\n", "camera 'rear'"),
        ("faults:\n- {name: mark_b_covered, onset_s: 0, size: 1}\n", "no geom 'mark_b'"),
    ],
)
def test_faults_that_are_none_end_with_2(tmp_path: Path, text: str, message: str):
    world, file = small_world(tmp_path), tmp_path / "faults.yaml"
    file.write_text(text)
    done = call("simulate", world.path, "-o", tmp_path / "out", "--faults", file, *SMALL)
    assert done.exit_code == 2
    assert message in done.output
    assert not list(tmp_path.glob("out/*"))


def test_a_camera_of_ones_own_is_read_and_refused(tmp_path: Path):
    world, file = small_world(tmp_path), tmp_path / "camera.yaml"
    for text, message in (
        ("readout: 0.01\n", "camera.yaml: option 'readout' is unknown; did you mean 'readout_s'"),
        ("blur_px: 99\n", "camera.yaml: blur_px = 99: must be a number from 0 to 10"),
    ):
        file.write_text(text)
        done = call("simulate", world.path, "-o", tmp_path / "out", "--camera", file, *SMALL)
        assert done.exit_code == 2
        assert message in said(done)
    done = call("simulate", world.path, "-o", tmp_path / "out", "--camera", "cheap", *SMALL)
    assert done.exit_code == 2
    assert "ideal, realistic" in done.output
    assert not list(tmp_path.glob("out/*"))
    file.write_text("preset: realistic\npictures: colour\n")
    done = call("simulate", world.path, "-o", tmp_path / "out", "--camera", file, *SMALL)
    assert done.exit_code == 0, done.output
    assert call("localize", tmp_path / "out", "-o", tmp_path / "r", "--no-report").exit_code == 0


def test_a_drive_is_recorded_alike_twice_with_all_that_goes_wrong(tmp_path: Path):
    from pilotage.simulation.sensor import Sensor

    world = small_world(tmp_path)
    faults = [Fault("swapped", 0, 0.5), Fault("frames_dropped", 0, 0.3, camera=RIGHT)]
    a, b = (
        record(world, tmp_path / f"{n}.mcap", faults=faults, sensor=Sensor.realistic())
        for n in "ab"
    )
    assert a.read_bytes() == b.read_bytes()
