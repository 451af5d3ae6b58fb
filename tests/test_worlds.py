# SPDX-License-Identifier: Apache-2.0
"""Worlds: valid from every seed, the same bytes from the same seed, clear where they have to be."""

from __future__ import annotations

import hashlib
import itertools
import subprocess
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from pilotage.errors import InputError
from pilotage.simulation import load_world, parse_path
from pilotage.simulation.grounds import GROUNDS
from pilotage.simulation.paths import SHAPES
from pilotage.simulation.relief import make_relief
from pilotage.simulation.scene import SURFACES
from pilotage.simulation.walkers import read_walk

# Ten seeds of each of three worlds, spread over those a user is likely to take.
SEEDS = [0, 1, 2, 3, 5, 8, 13, 21, 34, 299]
VARIANTS: list[tuple[str, dict[str, object]]] = [
    ("yard", {"relief_m": 0.1, "path": "closed-50m"}),
    ("corridor", {"corners": 3}),
    ("office", {}),
    ("office", {"person": "sit"}),
]


def compiled(name: str, seed: int, options: dict[str, object]) -> tuple[Any, Any]:
    model = load_world(name, seed=seed, options=options).spec().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def height_below(model: Any, data: Any, x: float, y: float) -> float:
    top = np.array([x, y, 2.0])
    hit = np.zeros(1, dtype=np.int32)
    return 2.0 - mujoco.mj_ray(model, data, top, np.array([0, 0, -1.0]), None, 1, -1, hit)


@pytest.mark.parametrize(("name", "options"), VARIANTS)
def test_every_seed_gives_a_valid_world_of_its_own(name: str, options: dict[str, object]):
    texts = set()
    for seed in SEEDS:
        world = load_world(name, seed=seed, options=options)
        texts.add(world.mjcf)
        spec = world.spec()
        model = spec.compile()
        names = {model.geom(i).name for i in range(model.ngeom)}
        assert {"ground", "mark_a", "mark_b"} <= names
        materials = {model.mat(i).name for i in range(model.nmat)}
        surfaces = [t for t in spec.texts if t.name.startswith("surface:")]
        assert surfaces
        for text in surfaces:
            assert text.name.removeprefix("surface:") in materials
            kind, seed_word, scale_word = text.data.split()
            assert kind in SURFACES
            assert int(seed_word.removeprefix("seed=")) > 0
            assert float(scale_word.removeprefix("scale=")) > 0
    assert len(texts) == len(SEEDS)


def test_the_same_seed_gives_the_same_bytes_in_another_process():
    program = (
        "import hashlib; from pilotage.simulation import load_world\n"
        "worlds = [load_world('yard', seed=7, options={'relief_m': 0.2}), "
        "load_world('corridor', seed=7), load_world('office', seed=7)]\n"
        "print(hashlib.sha256(''.join(w.mjcf for w in worlds).encode()).hexdigest())"
    )
    there = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, check=True, text=True
    ).stdout.strip()
    here = [load_world("yard", seed=7, options={"relief_m": 0.2})]
    here += [load_world("corridor", seed=7), load_world("office", seed=7)]
    assert hashlib.sha256("".join(w.mjcf for w in here).encode()).hexdigest() == there


@pytest.mark.parametrize("seed", [0, 4, 11])
def test_nothing_stands_in_anothers_place_or_in_the_way(seed: int):
    options = {"path": "closed-20m", "path_clear_m": 0.7, "clear_radius_m": 2.0, "objects": 25}
    model, data = compiled("yard", seed, options)
    solid = [i for i in range(model.ngeom) if model.geom_contype[i] and model.geom_bodyid[i] != 0]
    assert len({int(model.geom_bodyid[i]) for i in solid}) == 25
    for a, b in itertools.combinations(solid, 2):
        if model.geom_bodyid[a] != model.geom_bodyid[b]:
            assert mujoco.mj_geomDistance(model, data, a, b, 10.0, None) > 0.3
    path = parse_path("closed-20m").points[::10]
    for x, y in path:
        sides = [(x + 0.7 * np.cos(t), y + 0.7 * np.sin(t)) for t in np.arange(0, 6.2, 0.5)]
        assert max(height_below(model, data, *side) for side in sides) < 0.01
    for letter in "ab":
        x, y = data.geom_xpos[model.geom(f"mark_{letter}").id][:2]
        around = [(x + np.cos(t), y + np.sin(t)) for t in np.arange(0, 6.2, 0.3)]
        assert max(height_below(model, data, *place) for place in around) < 0.01


def test_relief_has_its_amplitude_and_is_level_at_the_start_and_the_marks():
    model, data = compiled("yard", 6, {"relief_m": 0.2, "objects": 0})
    grid = [height_below(model, data, x, y) for x in range(-14, 15) for y in range(-14, 15)]
    assert 0.2 < max(grid) - min(grid) < 0.45
    near = [height_below(model, data, np.cos(t), np.sin(t)) for t in np.arange(0, 6.2, 0.3)]
    assert np.ptp(near) < 1e-4
    for letter in "ab":
        place = data.geom_xpos[model.geom(f"mark_{letter}").id]
        below = height_below(model, data, place[0] + 0.3, place[1])
        assert below == pytest.approx(place[2], abs=2e-4)


def test_short_waves_of_relief_are_steeper_at_the_same_height():
    steepest, highest = [], []
    for wave_m in (5.0, 2.0):
        relief = make_relief(np.random.default_rng(1), (0.0, 0.0), 10.0, 0.1, wave_m)
        cell_m = 2 * relief.half_m / (len(relief.heights_m) - 1)
        steepest.append(np.abs(np.diff(relief.heights_m, axis=1)).max() / cell_m)
        highest.append(np.ptp(relief.heights_m))
    assert steepest[1] > 1.5 * steepest[0]
    assert all(0.1 < height < 0.25 for height in highest)


def test_a_plane_is_a_plane_and_each_ground_says_its_kind():
    frictions = set()
    for kind in GROUNDS:
        world = load_world("yard", seed=1, options={"ground": kind})
        assert f'name="surface:ground" data="{kind} seed=' in world.mjcf
        model = world.spec().compile()
        ground = model.geom("ground")
        assert ground.type == mujoco.mjtGeom.mjGEOM_PLANE
        frictions.add(float(ground.friction[0]))
    assert min(frictions) < max(frictions)


@pytest.mark.parametrize("width_m", [6.0, 6.8])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_person_walks_where_nothing_stands(width_m: float, seed: int):
    world = load_world("office", seed=seed, options={"width_m": width_m})
    spec = world.spec()
    walk = next(read_walk(t.name, t.data) for t in spec.texts if t.name.startswith("walk:"))
    model = spec.compile()
    data = mujoco.MjData(model)
    person = model.body("person")
    own = [i for i in range(model.ngeom) if model.geom_bodyid[i] == person.id]
    others = [i for i in range(model.ngeom) if i not in own and model.geom_contype[i] and i != 0]
    for moment in range(0, 16, 2):
        place, turn = walk.pose(moment)
        data.mocap_pos[person.mocapid[0], :2], data.mocap_quat[person.mocapid[0]] = place, turn
        mujoco.mj_forward(model, data)
        for a, b in itertools.product(own, others):
            near = np.linalg.norm(data.geom_xpos[a] - data.geom_xpos[b]) < 3
            if near and model.geom(b).name != "ground":
                assert mujoco.mj_geomDistance(model, data, a, b, 1.0, None) > 0, model.geom(b)


@pytest.mark.parametrize(("name", "options"), VARIANTS)
def test_the_start_is_free(name: str, options: dict[str, object]):
    for seed in SEEDS[:5]:
        model, data = compiled(name, seed, options)
        for angle in np.arange(0, 2 * np.pi, 0.1):
            ray = np.array([np.cos(angle), np.sin(angle), 0.0])
            hit = np.zeros(1, dtype=np.int32)
            free = mujoco.mj_ray(model, data, np.array([0, 0, 0.15]), ray, None, 1, -1, hit)
            assert free < 0 or free > 0.6


def test_corridors_are_as_long_as_asked_and_walled_in():
    model, data = compiled("corridor", 3, {"corners": 4, "length_m": 50.0, "objects": 0})
    hit = np.zeros(1, dtype=np.int32)
    b = data.geom_xpos[model.geom("mark_b").id]
    assert np.hypot(b[0], b[1]) > 15
    for place in (np.array([0, 0, 1.0]), np.array([b[0], b[1], 1.0])):
        for angle in np.arange(0, 2 * np.pi, 0.05):
            ray = np.array([np.cos(angle), np.sin(angle), 0.0])
            assert 0 < mujoco.mj_ray(model, data, place, ray, None, 1, -1, hit) < 40


def test_paths_begin_at_the_start_along_x_and_have_their_length():
    for shape in SHAPES:
        path = parse_path(f"{shape}-12.5m")
        assert path.length_m == pytest.approx(12.5, rel=2e-3)
        assert path.points[0] == pytest.approx([0, 0])
        assert np.arctan2(*path.points[1][::-1]) == pytest.approx(0, abs=0.02)
        gap = np.linalg.norm(path.points[-1])
        assert (gap < 1e-6) == path.is_closed


def test_walks_come_round():
    walk = read_walk("walk:x", "speed_m_s=0.5 points_m=0,0 1,0 1,1 0,1")
    assert walk.pose(1.0)[0] == pytest.approx([0.5, 0])
    assert walk.pose(8.0)[0] == pytest.approx([0, 0])
    assert walk.pose(3.0)[0] == pytest.approx([1, 0.5])
    assert walk.pose(3.0)[1] == pytest.approx([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("yrad", {}, ["yrad", "did you mean 'yard'"]),
        ("yard", {"grund": "sand"}, ["grund", "did you mean 'ground'"]),
        ("yard", {"ground": "lava"}, ["lava", "asphalt"]),
        ("yard", {"relief_m": -1}, ["relief_m = -1", "0 to 0.5"]),
        ("yard", {"objects": 2.5}, ["objects = 2.5", "whole number"]),
        ("yard", {"objects": 400, "size_m": 12}, ["objects = 400", "raise size_m"]),
        ("yard", {"path": "open-60m"}, ["open-60m", "raise size_m to"]),
        ("yard", {"path": "heart-10m"}, ["heart-10m", "closed"]),
        ("yard", {"path": "closed-0.1m"}, ["closed-0.1m", "from 1 to 1000 m"]),
        ("corridor", {"corners": True}, ["corners = True"]),
        ("office", {"person": "dog"}, ["dog", "stand"]),
        ("nowhere.xml", {}, ["nowhere.xml", "check the path"]),
    ],
)
def test_errors_name_value_and_remedy(name: str, options: dict[str, object], words: list[str]):
    with pytest.raises(InputError) as caught:
        load_world(name, options=options)
    for word in words:
        assert word in str(caught.value)


def test_broken_mjcf_is_told_in_mujocos_words(tmp_path: Path):
    file = tmp_path / "mine.xml"
    file.write_text('<mujoco><worldbody><geom type="spere" size="1"/></worldbody></mujoco>')
    with pytest.raises(InputError, match=r"mine\.xml.*spere"):
        load_world(file)
    file.write_text("<mujoco><worldbo")
    with pytest.raises(InputError, match=r"mine\.xml"):
        load_world(str(file))
    with pytest.raises(InputError, match="takes none"):
        load_world(file, options={"ground": "sand"})
    with pytest.raises(InputError, match="seed"):
        load_world("yard", seed=-1)
