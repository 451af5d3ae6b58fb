# SPDX-License-Identifier: Apache-2.0
"""Sweeps of a head joined into one wide view, against rendered truth; what cannot be joined."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from program import call, said, summary_of
from rendering import PinholeCamera, Renderer, room

from pilotage import Camera, _core
from pilotage.behaviors.mosaic import Link, chain

SMALL = PinholeCamera(320, 240, 272.0, 272.0, 160.5, 119.0)
CAMERA = Camera(width_px=320, height_px=240, fx_px=272, fy_px=272, cx_px=160.5, cy_px=119)
FOV_DEG = math.degrees(2 * math.atan(160 / 272))
AHEAD = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # world_from_camera: looks along x
STRIDE = 4  # of the pixels that are compared
YAWS_DEG = (33.5, 0.0, -33.5)
PITCHES_DEG = (-20.0, 0.0, 20.0)


def turn_of(yaw_deg: float, pitch_deg: float = 0.0) -> np.ndarray:
    """Return world_from_camera (3, 3); yaw positive to the left, pitch downward."""
    yaw, pitch = math.radians(yaw_deg), math.radians(pitch_deg)
    about_z = np.array([[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0],
                        [0, 0, 1]])  # fmt: skip
    about_y = np.array([[math.cos(pitch), 0, math.sin(pitch)], [0, 1, 0],
                        [-math.sin(pitch), 0, math.cos(pitch)]])  # fmt: skip
    return about_z @ about_y @ AHEAD


class Turning:
    """Pictures of a room by a camera that only turns, with a little noise."""

    def __init__(self) -> None:
        self.world = room(1.0, np.random.default_rng(1))
        self.random = np.random.default_rng(2)

    def picture(self, turn: np.ndarray, camera: PinholeCamera = SMALL) -> np.ndarray:
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn, [0.0, 0.0, 0.5]
        grey = cv2.GaussianBlur(Renderer(self.world, camera, 3).render(pose), (0, 0), 0.7)
        return np.clip(grey + self.random.normal(0, 1.0, grey.shape), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def turning() -> Turning:
    return Turning()


@pytest.fixture(scope="module")
def nine(turning: Turning, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("nine")
    for row, pitch in enumerate(PITCHES_DEG):
        for column, yaw in enumerate(YAWS_DEG):
            cv2.imwrite(str(folder / f"{row}{column}.png"), turning.picture(turn_of(yaw, pitch)))
    return folder


@pytest.fixture(scope="module")
def wide(nine: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("wide") / "out"
    done = call("mosaic", nine, "--fov-deg", FOV_DEG, "-o", out)
    assert done.exit_code == 0, done.output
    assert "9 of 9 pictures joined" in said(done)
    return out


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("walk") / "office"
    done = call(
        "simulate", "office", "--robot", "nao", "--seed", 3, "--set", "person=sit", "--width", 320,
        "--path", "straight-1m", "--stop-every", 100, "--crouch", "-o", out,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    return out


def table_of(out: Path) -> Iterator[dict[str, str]]:
    with (out / "features.csv").open(newline="") as file:
        yield from csv.DictReader(file)


def test_a_homography_is_found_among_wrong_matches():
    random = np.random.default_rng(4)
    true = np.array([[0.9, -0.1, 30], [0.08, 1.1, -12], [2e-4, -1e-4, 1]])
    a = random.uniform(0, 300, (120, 2))
    mapped = np.column_stack([a, np.ones(120)]) @ true.T
    b = mapped[:, :2] / mapped[:, 2:]
    b[:50] = random.uniform(0, 300, (50, 2))
    found = _core.find_homography(points_a=a, points_b=b)
    np.testing.assert_allclose(found.b_from_a, true, rtol=1e-5, atol=1e-8)
    assert found.inlier[50:].all()
    assert found.inlier_count == found.inlier.sum() < 75
    assert _core.find_homography(points_a=a[:50], points_b=b[:50]).b_from_a is None
    with pytest.raises(ValueError, match="120 points in one picture, 119"):
        _core.find_homography(points_a=a, points_b=b[:-1])


def test_maps_are_chained_over_the_surest_links():
    turns = [np.linalg.inv(turn_of(yaw)) for yaw in (0.0, 20.0, 40.0, 60.0)]

    def link(a: int, b: int, inliers: int, map_: np.ndarray | None = None) -> Link:
        b_from_a = turns[b] @ np.linalg.inv(turns[a]) if map_ is None else map_
        return Link(a=a, b=b, b_from_a=b_from_a, matches=99, inliers=inliers, rms_px=1.0)

    wrong = link(0, 2, 20, np.diag([1.0, 1.2, 1.0]))
    maps = chain([wrong, link(0, 1, 50), link(2, 1, 40)], 4, 0)
    for number in range(3):
        np.testing.assert_allclose(maps[number], turns[0] @ turns[number].T, atol=1e-12)
    assert maps[3] is None


def test_a_camera_that_only_turns_is_joined_exactly(turning: Turning, nine: Path, wide: Path):
    summary = summary_of(wide)
    assert summary["status"] == "joined"
    assert summary["middle"] == "11.png"
    assert summary["moving_centres"] is None
    for picture in summary["pictures"]:
        row, column = (int(digit) for digit in picture["name"][:2])
        true = turn_of(0.0).T @ turn_of(YAWS_DEG[column], PITCHES_DEG[row])
        map_ = np.array(picture["middle_from_picture"])
        map_ *= np.sign(map_[2, 2])
        np.testing.assert_allclose(map_ / np.cbrt(np.linalg.det(map_)), true, atol=0.02)


def test_the_wide_picture_is_what_a_wide_camera_would_see(turning: Turning, wide: Path):
    made = cv2.imread(str(wide / "mosaic.png"), cv2.IMREAD_GRAYSCALE)
    lens = summary_of(wide)["virtual_camera"]
    assert made.shape == (lens["height_px"], lens["width_px"])
    assert made.shape[1] > 2.5 * 320
    camera = PinholeCamera(lens["width_px"], lens["height_px"], lens["focal_px"], lens["focal_px"],
                           lens["cx_px"], lens["cy_px"])  # fmt: skip
    true = turning.picture(turn_of(0.0), camera)
    rows, columns = STRIDE * np.indices([-(-side // STRIDE) for side in made.shape])
    flat = np.stack([columns.ravel() - lens["cx_px"], rows.ravel() - lens["cy_px"]], axis=1)
    rays = np.column_stack([flat / lens["focal_px"], np.ones(len(flat))]) @ turn_of(0.0).T
    shown = np.zeros(len(flat), bool)
    for turn in (turn_of(yaw, pitch) for yaw in YAWS_DEG for pitch in PITCHES_DEG):
        pixels = CAMERA.project(rays @ turn)  # NaN behind the camera
        shown |= ((pixels > 2) & (pixels < [317, 237])).all(axis=1)
    assert summary_of(wide)["mosaic"]["seen"] == pytest.approx(shown.mean(), abs=0.03)
    # Smoothed, for sideways pictures are stretched and so less sharp than the truth.
    smooth = (cv2.GaussianBlur(picture, (0, 0), 2.0) for picture in (made, true))
    a, b = (picture[::STRIDE, ::STRIDE].ravel()[shown] for picture in smooth)
    assert np.corrcoef(a, b)[0, 1] > 0.97


def test_features_are_summed_in_the_virtual_camera(nine: Path, wide: Path):
    rows = list(table_of(wide))
    assert len(rows) == summary_of(wide)["features"]
    assert {row["picture"] for row in rows} == {file.name for file in nine.iterdir()}
    lens = summary_of(wide)["virtual_camera"]
    errors = []
    for row in rows:
        assert row["moving_x_px"] == row["distance_m"] == row["is_measured"] == ""
        ray = CAMERA.unproject(np.array([[float(row["x_px"]), float(row["y_px"])]]))[0]
        digits = [int(digit) for digit in row["picture"][:2]]
        true = turn_of(0).T @ turn_of(YAWS_DEG[digits[1]], PITCHES_DEG[digits[0]]) @ ray
        fixed = np.array([
            (float(row["fixed_x_px"]) - lens["cx_px"]) / lens["focal_px"],
            (float(row["fixed_y_px"]) - lens["cy_px"]) / lens["focal_px"], 1,
        ])  # fmt: skip
        errors.append(np.linalg.norm(np.cross(true, fixed / np.linalg.norm(fixed))))
    assert np.median(errors) * 272 < 1.0
    assert max(errors) * 272 < 8.0


def test_a_stop_of_a_recording(walk: Path, tmp_path: Path):
    out = tmp_path / "wide"
    done = call("mosaic", walk, "--stop", 1, "-o", out)
    assert done.exit_code == 0, done.output
    assert "by the neck's angles" in said(done)
    summary = summary_of(out)
    assert summary["stop"] == 1
    assert len(summary["pictures"]) == summary["other_pictures"] == 6
    assert summary["moving_centres"]["points"] > 400
    for picture in summary["pictures"]:
        assert picture["is_joined"] == (picture["reason"] == "")
        if not picture["is_joined"]:
            assert f"not in mosaic.png: {picture['reason']}" in said(done)
    rows = list(table_of(out))
    measured = [row for row in rows if row["is_measured"] == "1"]
    assert len(measured) == summary["moving_centres"]["measured_features"] > 500
    assert all(0.25 < float(row["distance_m"]) < 101 for row in rows)
    # Homographies may lose the bottom camera's pictures, whose overlap is narrow.
    for name, least in (("mosaic.png", 0.3), ("mosaic_moving_centres.png", 0.8)):
        picture = cv2.imread(str(out / name), cv2.IMREAD_GRAYSCALE)
        assert picture.shape[1] > 2.5 * 320
        assert (picture > 0).mean() > least
    assert call("mosaic", walk, "-o", out).exit_code == 2
    assert call("mosaic", walk, "-o", out, "--overwrite").exit_code == 0
    assert summary_of(out)["stop"] == 0


def test_pictures_that_share_nothing_are_named(nine: Path, tmp_path: Path, turning: Turning):
    folder = tmp_path / "pictures"
    folder.mkdir()
    for name in ("10.png", "11.png"):
        (folder / name).write_bytes((nine / name).read_bytes())
    cv2.imwrite(str(folder / "behind.png"), turning.picture(turn_of(180.0)))
    done = call("mosaic", folder, "--fov-deg", FOV_DEG, "-o", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert "behind.png: not in mosaic.png" in said(done)
    assert "2 of 3 pictures" in said(done)
    (folder / "11.png").unlink()
    done = call("mosaic", folder, "--fov-deg", FOV_DEG, "-o", tmp_path / "none")
    assert done.exit_code == 1
    assert "no two of the pictures" in said(done)
    assert summary_of(tmp_path / "none")["status"] == "refused"
    assert not (tmp_path / "none" / "mosaic.png").exists()


def test_blank_pictures_are_refused(tmp_path: Path):
    for number in range(2):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((240, 320), 128, np.uint8))
    done = call("mosaic", tmp_path, "--fov-deg", FOV_DEG, "-o", tmp_path / "out")
    assert done.exit_code == 1
    assert "could be joined" in said(done)


@pytest.mark.parametrize(
    ("case", "arguments", "words"),
    [
        ("missing", [], "does not exist"),
        ("empty", ["--fov-deg", "60"], "holds no pictures"),
        ("nine", [], "give --calibration, or --fov-deg"),
        ("nine", ["--fov-deg", "60", "--stop", "1"], "only a recording has stops"),
        ("nine", ["--fov-deg", "nan"], "field of view"),
        ("one", ["--fov-deg", "60"], "1 picture;"),
        ("unlike", ["--fov-deg", "60"], "100x80 pixels"),
        ("walk", ["--stop", "99"], "has no stop 99; choose one from 0 to 1"),
        ("walk", ["--stop", "-1"], "--stop"),
        ("walk", ["--fov-deg", "60"], "holds its own calibration"),
    ],
)
def test_misuse_is_named(
    case: str, arguments: list[str], words: str, request: pytest.FixtureRequest, tmp_path: Path
):
    source = tmp_path / case
    if case in {"nine", "walk"}:
        source = request.getfixturevalue(case)
    elif case != "missing":
        source.mkdir()
        sizes = {"one": [(240, 320)], "unlike": [(240, 320), (80, 100)]}.get(case, [])
        for number, size in enumerate(sizes):
            cv2.imwrite(str(source / f"{number}.png"), np.zeros(size, np.uint8))
    done = call("mosaic", source, *arguments, "-o", tmp_path / "out")
    assert done.exit_code == 2, done.output
    assert words in said(done)
    assert not (tmp_path / "out").exists()
