# SPDX-License-Identifier: Apache-2.0
"""Which paths fit into a world, and that robots get to the end of those that do."""

from __future__ import annotations

from pathlib import Path

import pytest

from pilotage.errors import InputError
from pilotage.simulation import ROBOTS, Drive, FreeFloor, Simulation, load_world, robot_model

POLE = """
<mujoco><worldbody>
 <geom name="ground" type="plane" size="0 0 1"/>
 <geom name="pole" type="cylinder" size="0.05 0.5" pos="{x} {y} 0.5"/>
 <geom name="beam" type="box" size="0.1 5 0.1" pos="1 0 1.5"/>
 <geom name="rug" type="box" size="1 1 0.01" pos="0 0 0"/>
</worldbody></mujoco>
"""


def floor_of(tmp_path: Path, x: float, y: float, *, radius_m: float = 0.4) -> FreeFloor:
    file = tmp_path / "pole.xml"
    file.write_text(POLE.format(x=x, y=y))
    return FreeFloor(load_world(file), radius_m)


def test_what_stands_near_the_path_is_found(tmp_path: Path) -> None:
    touch = floor_of(tmp_path, 2.0, 0.4).first_touch("straight-4m")
    assert touch is not None
    assert touch.what == "pole"
    assert touch.along_m == pytest.approx(1.8, abs=0.11)
    assert floor_of(tmp_path, 2.0, 0.5).first_touch("straight-4m") is None
    assert floor_of(tmp_path, 2.0, 0.4, radius_m=0.3).first_touch("straight-4m") is None
    # A robot that ends before it has a front, too.
    assert floor_of(tmp_path, 2.0, 0.0).first_touch("straight-1m") is None
    assert floor_of(tmp_path, 1.7, 0.0).first_touch("straight-1m") is not None


def test_a_path_that_does_not_fit_names_those_that_do(tmp_path: Path) -> None:
    floor = floor_of(tmp_path, 3.0, 0.0)
    with pytest.raises(InputError, match=r"2\.6 m along it .* pole; .* closed-50m, .*straight-2m"):
        floor.check("straight-4m")
    assert floor.choose(["straight-8m", "straight-4m", "straight-2m"]) == "straight-2m"
    with pytest.raises(InputError, match="not even straight-4m: pole is in the way"):
        floor.choose(["straight-8m", "straight-4m"])


def test_no_path_leads_over_the_edge_of_the_ground(tmp_path: Path) -> None:
    file = tmp_path / "table.xml"
    table = '<geom name="ground" type="box" size="2 2 0.1" pos="0 0 -0.1"/>'
    file.write_text(f"<mujoco><worldbody>{table}</worldbody></mujoco>")
    floor = FreeFloor(load_world(file), 0.4)
    with pytest.raises(InputError, match=r"2\.1 m .* the edge of the ground; .*straight-1m"):
        floor.check("straight-4m")
    assert floor.choose(["straight-4m", "straight-1m"]) == "straight-1m"


@pytest.mark.parametrize("person", ["stand", "walk"])
def test_persons_are_kept_away_from(person: str) -> None:
    floor = FreeFloor(load_world("office", seed=0, options={"person": person}), 0.4)
    touch = floor.first_touch("closed-50m")
    assert touch is not None
    assert "person" in touch.what


@pytest.mark.parametrize("seed", [0, 3, 8])
@pytest.mark.parametrize("world", ["office", "corridor"])
@pytest.mark.parametrize("robot", sorted(ROBOTS))
def test_every_robot_finds_a_path_in_every_room(robot: str, world: str, seed: int) -> None:
    model, loaded = robot_model(robot), load_world(world, seed=seed)
    path = FreeFloor(loaded, model.radius_m).choose(model.paths)
    drive = Drive(Simulation(loaded, robot, seed=seed), path, speed_m_s=model.speed_m_s)
    assert drive.path.length_m > 3.9
    if robot == "rover":
        assert drive.run()
        assert drive.largest_deviation_m < 0.05


def test_a_nao_gets_to_the_end_of_its_walk() -> None:
    simulation = Simulation(load_world("office", seed=4), "nao", seed=4)
    drive = Drive(simulation, "closed-3m", speed_m_s=0.095)
    assert drive.run()
    assert drive.largest_deviation_m < 0.1


def test_a_break_does_not_count_as_lateness() -> None:
    simulation = Simulation(load_world("yard", seed=1, options={"ground": "asphalt"}))
    drive = Drive(simulation, "straight-1m")
    for number, _ in enumerate(drive):
        if number == 20:
            simulation.advance(simulation.time_ns + 100_000_000_000)
    assert drive.has_arrived


@pytest.mark.parametrize("shape", ["closed", "open"])
@pytest.mark.parametrize("ground", ["asphalt", "grass", "gravel", "soil", "sand"])
def test_paths_are_driven_on_every_ground(ground: str, shape: str) -> None:
    options = {"ground": ground, "path": f"{shape}-5m", "relief_m": 0.05}
    simulation = Simulation(load_world("yard", seed=3, options=options))
    drive = Drive(simulation, f"{shape}-5m", speed_m_s=0.5)
    assert drive.run()
    assert drive.largest_deviation_m < 0.03
