# SPDX-License-Identifier: Apache-2.0
"""The benchmark of coming home in small: crowds, misled steps, carried robots, judgement."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"
sys.path.insert(0, str(BENCHMARKS))

import homing  # noqa: E402

from pilotage.behaviors.walk_account import RecordedWalk  # noqa: E402
from pilotage.simulation import Simulation  # noqa: E402
from pilotage.simulation.paths import parse_path  # noqa: E402

PATH, PEOPLE = "closed-4m", 2


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> RecordedWalk:
    world, _ = homing.crowded(homing.FIRST_SEED, PATH, PEOPLE)
    return homing.walk_of(world, PATH, 320, tmp_path_factory.mktemp("home") / "walk.mcap")


def test_people_walk_beside_the_path_in_clothes_of_their_own() -> None:
    world, walkers = homing.crowded(homing.FIRST_SEED, PATH, PEOPLE)
    simulation = Simulation(world, "nao", seed=1)
    names = {simulation.model.body(i).name for i in range(simulation.model.nbody)}
    assert {f"person_{i}" for i in range(PEOPLE)} <= names
    assert "person" not in names
    clothes = [f"surface:shirt_{i}" for i in range(PEOPLE)]
    assert all(name in world.mjcf for name in clothes)
    path = parse_path(PATH).points
    for walker in walkers:
        apart = np.linalg.norm(walker.points[:, None] - path[None], axis=2).min(axis=1)
        assert apart.min() > 0.5
        assert apart.max() < 1.2


def test_steps_are_told_with_a_further_error(walk: RecordedWalk) -> None:
    lengths = []
    for seed in range(40):
        told = [first.odom_from_robot for first in homing.misled(walk, seed).firsts]
        usual = [first.odom_from_robot for first in walk.firsts]
        for a, b, true_a, true_b in zip(told, told[1:], usual, usual[1:], strict=False):
            assert a is not None
            assert b is not None
            assert true_a is not None
            assert true_b is not None
            way = np.linalg.norm((a.inverse() @ b).translation_m)
            lengths.append(way / np.linalg.norm((true_a.inverse() @ true_b).translation_m) - 1)
    assert 0.07 < np.std(lengths) < 0.13
    assert abs(np.mean(lengths)) < 0.05


def test_a_carried_robot_tells_of_a_usual_step(walk: RecordedWalk) -> None:
    away = homing.carried(walk, 3, 5)
    stops = walk.stop_of_picture[-1] + 1
    assert away.stop_of_picture[-1] + 1 == stops - 2
    before, after = away.firsts[2].odom_from_robot, away.firsts[3].odom_from_robot
    usual_a, usual_b = walk.firsts[1].odom_from_robot, walk.firsts[2].odom_from_robot
    assert before is not None
    assert after is not None
    assert usual_a is not None
    assert usual_b is not None
    told = (before.inverse() @ after).matrix()
    np.testing.assert_allclose(told, (usual_a.inverse() @ usual_b).matrix(), atol=1e-9)
    # The pictures are those of the stop it was carried to.
    assert away.firsts[3].timestamp_ns == walk.firsts[5].timestamp_ns


def test_a_room_is_measured_and_judged() -> None:
    (room,) = homing.rooms_of(1, PATH, PEOPLE)
    row = homing.measure(room, path=PATH, width=320, people=PEOPLE)
    assert row["wrong"] == 0
    assert homing.is_home(row)
    assert row["home_m"] < row["steps_home_m"]
    assert 0 < row["on_people"] < 1
    assert not homing.is_home({**row, "home_m": 0.06})
    assert not homing.is_home({**row, "home_placed": False})
    printed = homing.table([row, {**row, "home_deg": 3.0}])
    assert "| home within 5 cm and 2 degrees | 1 of 2 |" in printed
