# SPDX-License-Identifier: Apache-2.0
"""Camera faults by name, each seen in the pictures, the stamps or the calibration it leaves."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from camera_scenes import LEFT, QUIET, RIGHT, Picture, differing, lenses, shots, small_world
from numpy.typing import NDArray

from pilotage.errors import InputError
from pilotage.simulation import (
    Fault,
    Motion,
    Simulation,
    World,
    load_world,
    read_faults,
)
from pilotage.simulation.faults import KINDS
from pilotage.simulation.mark_covers import LEAF_M, scatter

# Shots come at 0.1, 0.2, 0.3 s: the fault acts in the last one only.
ONSET_S = 0.25


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return small_world(tmp_path_factory.mktemp("faults"))


def last_with(world: World, *faults: Fault) -> tuple[Picture, Picture]:
    """Return left and right of the last shot of a rover that stands."""
    pictures = shots(world, sensor=QUIET, faults=faults)[-1].pictures
    return pictures[LEFT], pictures[RIGHT]


def test_a_fault_starts_at_its_onset_and_ends_with_its_duration(world: World):
    faults = [Fault("blind", 0.15, 1.0, duration_s=0.1)]
    means = [s.pictures[LEFT].mean() for s in shots(world, sensor=QUIET, faults=faults)]
    assert means[1] == 0
    assert min(means[0], means[2]) > 50


@pytest.mark.parametrize("camera", ["front_left", "left", "front", "all"])
def test_blind_cameras_see_nothing(world: World, camera: str):
    blind = last_with(world, Fault("blind", ONSET_S, 1.0, camera=camera))
    assert blind[0].max() == 0
    # The other camera sees on, as well exposed as before.
    assert blind[1].mean() == pytest.approx(0 if camera in {"front", "all"} else 110, abs=12)
    half = last_with(world, Fault("blind", ONSET_S, 0.5, camera=camera))[0]
    assert half[:, :70].max() == 0
    assert half[:, 90:].mean() > 50


def test_dirt_dims_the_same_places_whatever_is_seen(world: World):
    plain, _ = last_with(world)
    dirty, right = last_with(world, Fault("dirt", ONSET_S, 0.3, camera="left"))
    dimmed = dirty < 0.75 * plain.astype(float)
    assert 0.2 < dimmed[plain > 20].mean() < 0.45
    assert differing(right, last_with(world)[1]) < 0.02
    faults = [Fault("dirt", 0, 0.3)]
    turning = Motion(0, 0, 1.0)
    taken = shots(world, sensor=QUIET, faults=faults, motion=turning, count=10)
    # Where views change and the dirt does not, the mean over time keeps the blotches.
    mean = np.mean([s.pictures[LEFT] for s in taken], axis=0)
    clean = np.mean(
        [s.pictures[LEFT] for s in shots(world, sensor=QUIET, motion=turning, count=10)], axis=0
    )
    assert (mean[dimmed] / clean[dimmed]).mean() < 0.7 < (mean / clean)[~dimmed].mean()


def test_glare_saturates_a_part_and_veils_the_rest(world: World):
    plain, _ = last_with(world)
    dazzled, _ = last_with(world, Fault("glare", ONSET_S, 0.1))
    assert (dazzled == 255).mean() > 0.1
    rest = dazzled < 255
    assert (dazzled[rest].astype(float) - plain[rest]).mean() > 10
    settled = shots(world, sensor=QUIET, faults=[Fault("glare", 0, 0.1)], count=12)[-1]
    picture = settled.pictures[LEFT]
    assert (picture == 255).mean() == pytest.approx(0.1, abs=0.03)
    # Less contrast where it does not dazzle: the veil lifts the dark, the exposure dims the bright.
    assert picture[picture < 255].std() < 0.4 * plain.std()


def test_darkness_takes_light_away(world: World):
    plain, _ = last_with(world)
    dark, _ = last_with(world, Fault("darkness", ONSET_S, 0.75))
    assert dark.mean() == pytest.approx(0.25 * plain.mean(), rel=0.1)


def test_blur_takes_detail_away(world: World):
    plain, right = last_with(world)
    blurred, sharp = last_with(world, Fault("blur", ONSET_S, 3.0, camera=LEFT))
    assert np.diff(blurred.astype(float)).std() < 0.3 * np.diff(plain.astype(float)).std()
    assert differing(sharp, right) < 0.02


def rotation(axis: int, angle: float) -> NDArray[np.float64]:
    """Return the right-handed turn about an axis."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[j, j] = turn[k, k] = math.cos(angle)
    turn[j, k], turn[k, j] = -math.sin(angle), math.sin(angle)
    return turn


def mark_px(world: World, *faults: Fault) -> dict[str, NDArray[np.float64]]:
    """Return x, y of the middle of the red mark in both pictures."""
    sensor = replace(QUIET, pictures="colour")
    pictures = shots(world, sensor=sensor, faults=faults)[-1].pictures
    found = {}
    for name, picture in pictures.items():
        blue, green, red = np.moveaxis(picture.astype(int), 2, 0)
        y, x = np.nonzero((red > 2 * green + 20) & (red > 2 * blue))
        assert len(x) > 100
        found[name] = np.array([x.mean(), y.mean()])
    return found


@pytest.mark.parametrize("kind", ["tilt", "shift"])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_moved_camera_sees_from_where_it_is(world: World, kind: str, axis: int):
    names = {
        "tilt": ("tilt_up", "tilt_right", "tilt_clockwise"),
        "shift": ("shift_right", "shift_down", "shift_forward"),
    }
    size = 6.0 if kind == "tilt" else 120.0
    before = mark_px(world)
    after = mark_px(world, Fault(names[kind][axis], ONSET_S, size, camera="left"))
    simulation = Simulation(world)
    lens = lenses(simulation)[LEFT]
    mark = simulation.camera_pose(LEFT).inverse() @ np.array([2.0, -0.1, 0.001])
    if kind == "tilt":
        mark_after = rotation(axis, math.radians(size)).T @ mark
    else:
        mark_after = mark - 1e-3 * size * np.eye(3)[axis]
    was, now = lens.project(np.array([mark, mark_after]))
    assert np.linalg.norm(now - was) > 2
    assert after[LEFT] - before[LEFT] == pytest.approx(now - was, abs=0.7)
    assert after[RIGHT] == pytest.approx(before[RIGHT], abs=0.1)


def test_one_side_falls_milliseconds_behind(world: World):
    driving = Motion(0, 0, 1.0)
    fault = Fault("out_of_step_ms", 0.0, 50.0)
    # A shot 50 ms earlier shows the right camera's view.
    plain = shots(world, sensor=QUIET, motion=driving, count=6)[-1]
    lagging = shots(world, sensor=QUIET, motion=driving, count=6, faults=[fault])[-1]
    assert (lagging.pictures[LEFT] == plain.pictures[LEFT]).all()
    assert differing(lagging.pictures[RIGHT], plain.pictures[RIGHT]) > 0.1
    assert lagging.stamps_ns == plain.stamps_ns
    leading = [Fault("out_of_step_ms", 0.0, -50.0)]
    other = shots(world, sensor=QUIET, motion=driving, count=6, faults=leading)[-1]
    assert differing(other.pictures[LEFT], plain.pictures[LEFT]) > 0.1


def test_a_covered_mark_loses_its_colour(world: World):
    sensor = replace(QUIET, pictures="colour")
    redness = {}
    for share in (0.4, 1.0):
        faults = [Fault("mark_a_covered", ONSET_S, share)]
        taken = shots(world, sensor=sensor, faults=faults)
        seen = [s.pictures[LEFT][70:].astype(int) for s in taken]  # below the reddish wall
        redness[share] = [int(np.maximum(p[..., 2] - p[..., 1], 0).sum()) for p in seen]
        assert redness[share][1] == pytest.approx(redness[share][0], rel=0.05)
    left = (redness[0.4][2] - redness[1.0][2]) / (redness[0.4][1] - redness[1.0][2])
    assert left == pytest.approx(0.6, abs=0.12)
    assert redness[1.0][2] < 0.1 * redness[1.0][1]


@pytest.mark.parametrize("share", [0.0, 0.3, 0.7, 1.0])
def test_leaves_hide_the_share_they_are_told_to(share: float):
    leaves = scatter(np.random.default_rng(1), share, 0.2)
    x, y = np.random.default_rng(2).uniform(-0.2, 0.2, (2, 20000))
    hidden = np.zeros(len(x), bool)
    for x0, y0, yaw in leaves:
        c, s = math.cos(yaw), math.sin(yaw)
        along, across = c * (x - x0) + s * (y - y0), c * (y - y0) - s * (x - x0)
        hidden |= (along / LEAF_M[0]) ** 2 + (across / LEAF_M[1]) ** 2 <= 1
    assert hidden[np.hypot(x, y) < 0.2].mean() == pytest.approx(share, abs=0.04)


def test_a_mark_that_is_not_there_cannot_be_covered(world: World):
    with pytest.raises(InputError, match="small: fault mark_b_covered: there is no geom 'mark_b'"):
        Simulation(world, faults=[Fault("mark_b_covered", 0, 0.5)])


def test_every_camera_fault_fits_the_rover_and_is_read_from_yaml(tmp_path: Path):
    lines = [
        f"- {{name: {name}, onset_s: 0, size: {kind.high}}}"
        for name, kind in KINDS.items()
        if kind.part != "body"
    ]
    file = tmp_path / "faults.yaml"
    file.write_text("faults:\n" + "\n".join(lines) + "\n")
    simulation = Simulation(load_world("yard", seed=1), faults=read_faults(file))
    assert len(simulation.faults) == len(lines)


def test_the_documents_name_every_fault():
    docs = Path(__file__).resolve().parents[1] / "docs"
    for name, kind in KINDS.items():
        file = "worlds.md" if kind.part == "body" else "cameras.md"
        assert f"`{name}`" in (docs / file).read_text(), name


def test_faults_that_cannot_be_are_refused(world: World):
    good = {"name": "blur", "onset_s": 0.0, "size": 1.0}
    for change, words in (
        ({"name": "blurr"}, "did you mean 'blur'"),
        ({"name": ["blur"]}, "must be a word"),
        ({"size": 60}, "pixels, 0 to 50"),
        ({"size": math.nan}, "size = nan"),
        ({"camera": 3}, "camera = 3"),
        ({"name": "slip", "camera": "left"}, "a fault of no camera"),
        ({"name": "wrong_base", "onset_s": 1}, "onset_s = 1: must be left out or 0"),
        ({"name": "wrong_base", "duration_s": 1}, "duration_s = 1"),
        ({"name": "out_of_step_frames", "size": 0.5}, "a whole number"),
    ):
        with pytest.raises(InputError, match=words):
            read_faults([good | change])
    for body, fault, words in (
        ("rover", Fault("blur", 0, 1, camera="rear"), "camera 'rear' is unknown.*front_left"),
        ("rover", Fault("swapped", 0, 1, camera="left"), "must be a pair: down, front"),
        ("nao", Fault("swapped", 0, 1), "'swapped' does not fit"),
        ("nao", Fault("blur", 0, 1, camera="left"), "top"),
    ):
        with pytest.raises(InputError, match=words):
            Simulation(world, body, faults=[fault])
