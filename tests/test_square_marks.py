# SPDX-License-Identifier: Apache-2.0
"""Printed marks of a known size make metres of a model's lengths."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from program import call, said
from rendering import PinholeCamera, Renderer, World

from pilotage import Camera, LengthSource, Transform, _core
from pilotage.behaviors.square_marks import FAMILIES, MarkSize, find_marks
from pilotage.behaviors.walk import place_walk
from pilotage.behaviors.walk_account import RecordedWalk, read_walk
from pilotage.models import read_colmap_text
from pilotage.recordings import open_pictures
from pilotage.recordings.motion import nearest

PINHOLE = PinholeCamera(480, 360, 420.0, 420.0, 239.5, 179.5)
FOV_DEG = float(np.degrees(2 * np.arctan(240 / 420)))
SIDE_M = 0.18
STEP_M = 0.15
FINE = 4  # samples of a pixel along either axis
Lens = PinholeCamera


@dataclass(frozen=True)
class Mark:
    """An upright square about a place, seen from where `along` goes to the right."""

    number: int
    centre: tuple[float, float, float]
    along: tuple[float, float, float] = (1, 0, 0)
    family: str = "apriltag-36h11"


def corner_of_room() -> World:
    world = World()
    world.add((-3, 2.0, -1), (6, 0, 0), (0, 0, 2.2))
    world.add((-3, -1, -0.6), (6, 0, 0), (0, 3, 0))
    world.add_box((-1.2, 1.3, -0.5), (-0.7, 1.7, 0.0))
    world.add_box((0.9, 1.0, -0.6), (1.4, 1.5, 0.2))
    return world


def stick(picture: np.ndarray, mark: Mark, pose: np.ndarray, lens: Lens) -> None:
    """Draw a mark before all else, with a white rim as broad as its bits."""
    rim, whole = 10, 100
    sheet = np.full((whole, whole), 255, np.uint8)
    family = cv2.aruco.getPredefinedDictionary(FAMILIES[mark.family])
    sheet[rim:-rim, rim:-rim] = cv2.aruco.generateImageMarker(family, mark.number, whole - 2 * rim)
    half = SIDE_M / 2 * whole / (whole - 2 * rim)
    sides = half * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]])
    points = mark.centre + sides[:, :1] * np.array(mark.along) + sides[:, 1:] * (0, 0, 1)
    in_camera = (points - pose[:3, 3]) @ pose[:3, :3]
    if in_camera[:, 2].min() < 0.2:
        return
    px = in_camera[:, :2] / in_camera[:, 2:] * (lens.fx, lens.fy) + (lens.cx, lens.cy)
    onto = cv2.getPerspectiveTransform(
        np.array([[0, 0], [whole, 0], [whole, whole], [0, whole]], np.float32) - 0.5,
        (FINE * (px + 0.5) - 0.5).astype(np.float32),
    )
    small = lens.width, lens.height
    size = (FINE * lens.width, FINE * lens.height)
    shown = cv2.warpPerspective(sheet, onto, size, flags=cv2.INTER_AREA)
    cover = cv2.warpPerspective(np.full_like(sheet, 255), onto, size, flags=cv2.INTER_AREA)
    share = cv2.resize(cover, small, interpolation=cv2.INTER_AREA) / 255
    mean = cv2.resize(shown, small, interpolation=cv2.INTER_AREA)
    picture[:] = np.round((1 - share) * picture + mean).clip(0, 255).astype(np.uint8)


def poses(count: int) -> list[np.ndarray]:
    # World: x right, y ahead, z up; the camera: x right, y down, z ahead.
    found = []
    for i in range(count):
        yaw = 0.1 - 0.05 * i
        pose = np.eye(4)
        turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
        pose[:3, :3] = turn @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
        pose[:3, 3] = STEP_M * i - 0.3, -0.4 + 0.02 * i, 0.03 * i
        found.append(pose)
    return found


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("marks")
    renderer = Renderer(corner_of_room(), PINHOLE, 4)
    noise = np.random.default_rng(5)
    for i, pose in enumerate(poses(5)):
        grey = renderer.render(pose) + noise.normal(0, 1.5, (PINHOLE.height, PINHOLE.width))
        picture = np.clip(grey, 0, 255).astype(np.uint8)
        stick(picture, Mark(3, (0.1, 2.0, 0.4)), pose, PINHOLE)
        stick(picture, Mark(8, (0.45, 2.0, -0.1)), pose, PINHOLE)
        cv2.imwrite(str(folder / f"{i}.png"), picture)
    return folder


def run(pictures: Path, out: Path, *more: object) -> tuple[int, dict[str, Any], str]:
    done = call(
        "reconstruct", pictures, "--fov-deg", FOV_DEG, "-o", out, "--no-report", *more
    )  # fmt: skip
    file = out / "summary.json"
    return done.exit_code, json.loads(file.read_text()) if file.exists() else {}, said(done)


def test_lengths_are_metres_by_the_side_of_marks(pictures: Path, tmp_path: Path):
    code, summary, words = run(pictures, tmp_path / "out", "--mark-size-m", SIDE_M)
    assert code == 0, words
    assert summary["unit"] == "m"
    lengths = summary["lengths"]
    assert lengths["sources"][0]["count"] == 2
    relative = lengths["sigma"] / lengths["factor"]
    assert relative < 0.01
    model = read_colmap_text(tmp_path / "out" / "colmap_text")
    centres = model.world_from_camera()[:, :3, 3]
    true = np.array([pose[:3, 3] for pose in poses(5)])
    ratio = np.linalg.norm(centres[-1] - centres[0]) / np.linalg.norm(true[-1] - true[0])
    assert ratio == pytest.approx(1, abs=4 * relative)
    assert "by marks of a known size" in words


def test_marks_that_are_not_there_leave_the_models_unit(pictures: Path, tmp_path: Path):
    options = "--mark-size-m", SIDE_M, "--mark-family", "aruco-4x4"
    code, summary, words = run(pictures, tmp_path / "out", *options)
    assert code == 0
    assert summary["unit"] == "unknown"
    assert "no mark of the family aruco-4x4" in summary["length_fault"]
    assert "lengths are in the model's own unit" in " ".join(words.split())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--mark-size-m", "0"), "must be the side of the black square in metres"),
        (("--mark-size-m", "0.1", "--mark-family", "qr"), "--mark-family qr: must be one of"),
    ],
)
def test_sizes_and_families_that_make_no_sense_are_refused(
    pictures: Path, tmp_path: Path, options: tuple[str, ...], words: str
):
    code, _, output = run(pictures, tmp_path / "out", *options)
    assert code == 2
    assert words in " ".join(output.split())
    assert not (tmp_path / "out").exists()


def test_corners_are_found_to_a_fraction_of_a_pixel(pictures: Path):
    camera = Camera(
        width_px=480, height_px=360, fx_px=420, fy_px=420, cx_px=239.5, cy_px=179.5
    )  # fmt: skip
    greys = [cv2.imread(str(pictures / f"{i}.png"), cv2.IMREAD_GRAYSCALE) for i in range(5)]
    account = find_marks(greys, [camera], [0] * 5, MarkSize(side_m=SIDE_M))
    assert sorted({s.mark for s in account.sightings}) == [3, 8]
    assert len(account.sightings) == 10
    true = [Transform.from_matrix(np.linalg.inv(pose)) for pose in poses(5)]
    length = _core.mark_length(marks=account, camera_from_world=true)
    assert length is not None
    assert length.source == LengthSource.marks
    assert abs(length.factor - 1) < 4 * length.sigma
    assert length.sigma < 0.008


@pytest.fixture(scope="module")
def marked_walk(tmp_path_factory: pytest.TempPathFactory) -> RecordedWalk:
    """A Nao's walk of a metre, with a mark before it drawn into every picture that shows it."""
    out = tmp_path_factory.mktemp("walk") / "office"
    done = call(
        "simulate", "office", "--robot", "nao", "--seed", 3, "--set", "person=sit", "--width", 320,
        "--path", "straight-1m", "--stop-every", 8, "--camera", "ideal", "-o", out,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    walk = read_walk(open_pictures(out))
    robot = walk.recording.truth("robot")
    assert robot is not None
    x, y, _ = robot.poses[0, :3, 3] + 1.8 * robot.poses[0, :3, 0]
    right = -robot.poses[0, :3, 1]
    mark = Mark(5, (x, y, 0.5), tuple(right), family="aruco-4x4")
    pictures = []
    for picture in walk.pictures:
        truth = walk.recording.truth(picture.camera)
        assert truth is not None
        at = nearest(truth.timestamps_ns, picture.timestamp_ns, within_ns=10**7)
        assert at is not None
        camera = walk.recording.cameras[picture.camera]
        focal_px, centre_px = (camera.fx_px, camera.fy_px), (camera.cx_px, camera.cy_px)
        lens = Lens(camera.width_px, camera.height_px, *focal_px, *centre_px)
        drawn = np.array(picture.picture)
        stick(drawn, mark, truth.poses[at], lens)
        pictures.append(replace(picture, picture=drawn))
    return replace(walk, pictures=tuple(pictures))


@pytest.mark.parametrize("told", [1.0, 1.2])
def test_marks_are_one_more_source_of_a_walks_lengths(marked_walk: RecordedWalk, told: float):
    size = MarkSize(side_m=told * SIDE_M, family="aruco-4x4")
    result = place_walk(marked_walk, marks=size).result
    estimates = {one.source: one for one in result.lengths}
    mark, steps = estimates[LengthSource.marks], estimates[LengthSource.steps]
    assert mark.count == 1
    assert mark.sigma < 0.02
    assert mark.factor / told == pytest.approx(steps.factor, abs=4 * np.hypot(0.02, steps.sigma))
    without = place_walk(marked_walk).result
    assert LengthSource.marks not in {one.source for one in without.lengths}
    # A side told wrongly contradicts the others, and nothing is sure any more.
    if told == 1.0:
        assert result.length_sigma < 1.5 * without.length_sigma
    else:
        assert result.length_sigma > 3 * without.length_sigma
