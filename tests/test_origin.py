# SPDX-License-Identifier: Apache-2.0
"""A simulated recording says with what it was made, and can be made again from that."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from camera_scenes import record, small_world
from program import call, summary_of

from pilotage import __version__
from pilotage.behaviors.simulate import read_origin, record_drive
from pilotage.behaviors.stop_and_go import StopPlan
from pilotage.errors import InputError
from pilotage.recordings.mcap_index import read_metadata
from pilotage.recordings.mcap_writer import McapWriter
from pilotage.recordings.recording import SIMULATION
from pilotage.robots.robot import HeadAngles
from pilotage.simulation import (
    Drive,
    Encoders,
    Fault,
    Sensor,
    Simulation,
    load_world,
    read_faults,
    read_sensor,
    robot_model,
)
from pilotage.simulation.origin import Origin

SMALL = ["--path", "straight-1m", "--width", "160", "--seed", "5"]
FAULTS = """
faults:
- {name: blind, onset_s: 0.5, size: 0.75, duration_s: 0.3, camera: front_left}
- {name: slip, onset_s: 1.25, size: 0.8}
- {name: wrong_base, onset_s: 0, size: 1.02}
"""
CAMERA = "{preset: realistic, exposure_s: 0.004, readout_s: 0.0123, drop_share: 0}"


@pytest.fixture(scope="module")
def spoilt(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive with faults and a camera of its own."""
    folder = tmp_path_factory.mktemp("spoilt")
    (folder / "faults.yaml").write_text(FAULTS)
    (folder / "camera.yaml").write_text(CAMERA)
    own = ["--faults", folder / "faults.yaml", "--camera", folder / "camera.yaml"]
    rest = ["--ground", "gravel", "--set", "relief_m=0.05", "--rate-hz", "4", "--speed", "0.7"]
    done = call("simulate", "yard", "-o", folder / "drive", *own, *rest, *SMALL)
    assert done.exit_code == 0, done.output
    return folder


def origin_in(path: Path) -> Origin:
    origin = read_origin(path)
    assert origin is not None
    return origin


def test_faults_and_camera_come_back_as_they_were_given(spoilt: Path):
    origin = origin_in(spoilt / "drive")
    assert origin.faults == tuple(read_faults(spoilt / "faults.yaml"))
    assert origin.camera == read_sensor(spoilt / "camera.yaml")
    assert origin.camera.readout_s == 0.0123
    assert (origin.world, origin.seed, origin.body_seed) == ("yard", 5, 5)
    assert origin.world_options["ground"] == "gravel"
    assert origin.world_options["relief_m"] == 0.05
    assert (origin.robot, origin.path, origin.speed_m_s) == ("rover", "straight-1m", 0.7)
    assert (origin.width_px, origin.rate_hz, origin.pairs) == (160, 4.0, ("front", "down"))
    assert (origin.stops, origin.encoders, origin.version) == (None, None, __version__)


def test_the_record_holds_every_value_of_the_camera(spoilt: Path):
    record = read_metadata(spoilt / "drive" / "recording.mcap", SIMULATION)
    assert record is not None
    camera = json.loads(record["camera"])
    assert set(camera) == set(Sensor.__dataclass_fields__)
    assert camera["exposure_s"] == 0.004
    assert record["words"] == (
        "yard (gravel); seed 5; rover along straight-1m at 0.7 m/s; camera with settings of its"
        " own; faults: blind 0.75 of front_left from 0.5 s for 0.3 s, slip 0.8 from 1.25 s,"
        " wrong_base 1.02"
    )


def test_a_recording_is_made_again_from_what_it_says(spoilt: Path, tmp_path: Path):
    origin = origin_in(spoilt / "drive")
    world = load_world(origin.world, seed=origin.seed, options=origin.world_options)
    simulation = Simulation(world, origin.robot, seed=origin.body_seed, faults=origin.faults)
    record_drive(
        simulation=simulation,
        robot=robot_model(origin.robot),
        drive=Drive(simulation, origin.path, speed_m_s=origin.speed_m_s),
        out=tmp_path / "again.mcap",
        width_px=origin.width_px,
        rate_hz=origin.rate_hz or 0.0,
        sensor=origin.camera,
        on_moment=lambda moment: None,
        pairs=origin.pairs,
    )
    before = (spoilt / "drive" / "recording.mcap").read_bytes()
    assert (tmp_path / "again.mcap").read_bytes() == before


def test_localize_names_it_in_summary_and_report(spoilt: Path, tmp_path: Path):
    out = tmp_path / "out"
    assert call("localize", spoilt / "drive", "--pair", "down", "-o", out).exit_code == 0
    told = summary_of(out)["recording"]["simulated"]
    assert told == origin_in(spoilt / "drive").words
    assert f"Simulated: {told}" in (out / "report.html").read_text()


def test_a_walk_says_its_stops_and_encoders(tmp_path: Path):
    out = tmp_path / "walk"
    looks = ["--looks", "10,-20:5", "--crouch", "--encoders", "2", "--set", "person=none"]
    done = call(
        "simulate", "office", "--robot", "nao", "-o", out, "--stop-every", "40", *looks, *SMALL
    )
    assert done.exit_code == 0, done.output
    origin = origin_in(out)
    assert (origin.robot, origin.rate_hz, origin.pairs) == ("nao", None, ())
    assert origin.encoders == Encoders().scaled(2)
    assert origin.stops is not None
    plan = {**origin.stops}
    seen = tuple(HeadAngles(*look) for look in plan.pop("looks_rad"))
    assert StopPlan(**plan, looks=seen).to_dict() == origin.stops
    assert (plan["steps"], plan["crouches"]) == (40, True)
    assert origin.words.endswith("nao along straight-1m at 0.095 m/s; camera good; no faults")


def test_a_world_of_a_file_is_named_with_its_hash(tmp_path: Path):
    world = small_world(tmp_path)
    faults = [Fault("dirt", 0.0, 0.2, camera="left")]
    origin = origin_in(record(world, tmp_path / "small.mcap", faults=faults))
    assert origin.world == "small.xml"
    assert len(origin.world_sha256) == 64
    assert origin.faults == tuple(faults)
    (tmp_path / "other").mkdir()
    other = small_world(tmp_path / "other", wall_x_m=6.0)
    assert origin_in(record(other, tmp_path / "b.mcap")).world_sha256 != origin.world_sha256


def test_it_survives_a_crash(spoilt: Path, tmp_path: Path):
    whole = (spoilt / "drive" / "recording.mcap").read_bytes()
    part = tmp_path / "cut.mcap.part"
    part.write_bytes(whole[: len(whole) // 2])
    assert call("recover", part).exit_code == 0
    assert origin_in(tmp_path / "cut.mcap") == origin_in(spoilt / "drive")


def test_it_goes_along_into_another_recording(spoilt: Path, tmp_path: Path):
    out = tmp_path / "front.mcap"
    assert call("convert", spoilt / "drive", "-o", out, "--to", "mcap").exit_code == 0
    assert origin_in(out) == origin_in(spoilt / "drive")


def written(path: Path, values: dict[str, str], name: str = SIMULATION) -> Path:
    with McapWriter(path) as writer:
        writer.write_metadata(name, values)
    return path


def test_others_say_nothing_and_broken_records_are_refused(tmp_path: Path):
    assert read_origin(written(tmp_path / "real.mcap", {"by": "hand"}, "notes")) is None
    for number, (values, why) in enumerate(
        [
            ({"words": "a yard"}, "has no world"),
            ({"world": "yard", "world_sha256": "", "seed": "seven"}, "seed = 'seven' is no JSON"),
        ]
    ):
        file = written(tmp_path / f"broken{number}.mcap", values)
        with pytest.raises(InputError, match=f"{file.name}: {SIMULATION}: {why}"):
            read_origin(file)


def test_a_camera_of_another_version_is_refused_by_its_key(spoilt: Path, tmp_path: Path):
    record = read_metadata(spoilt / "drive" / "recording.mcap", SIMULATION)
    assert record is not None
    camera = {**json.loads(record["camera"]), "smear": 1.0}
    file = written(tmp_path / "new.mcap", {**record, "camera": json.dumps(camera)})
    with pytest.raises(InputError, match="'smear' is unknown"):
        read_origin(file)
