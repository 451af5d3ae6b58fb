# SPDX-License-Identifier: Apache-2.0
"""Depth from two pictures a known distance apart, against rendered truth; what is refused."""

from __future__ import annotations

import math
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from program import call, said, summary_of
from rendering import PinholeCamera, Renderer, World, room

from pilotage import Camera, Transform
from pilotage.behaviors.depth import Depth, measure_depth
from pilotage.behaviors.obstacles import distance_at, find_ground, find_obstacles
from pilotage.errors import InputError
from pilotage.models.ply import read_ply
from pilotage.recordings.pictures import decode_grey

BASELINE_M = 0.11
LENS = PinholeCamera(640, 480, 545.0, 545.0, 321.0, 238.0)
CAMERA = Camera(width_px=640, height_px=480, fx_px=545, fy_px=545, cx_px=321, cy_px=238)
FOV_DEG = math.degrees(2 * math.atan(320 / 545))
AHEAD = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # world_from_camera: looks along x
EYE_M = np.array([0.0, 0.0, 0.55])


class Scene:
    """Pictures of a room with two boxes, and the true depth of their pixels."""

    def __init__(self, world: World, *, seed: int = 3) -> None:
        self.renderer = Renderer(world, LENS, seed)
        self.random = np.random.default_rng(seed)

    def picture(self, *, up_m: float = 0.0, turn: tuple[float, float, float] = (0, 0, 0)):
        """Return the picture from above the eye's place by `up_m`, turned, with noise."""
        grey = self.renderer.render(self._pose(up_m, turn))
        grey = cv2.GaussianBlur(grey, (0, 0), 0.7)
        return np.clip(grey + self.random.normal(0, 1.5, grey.shape), 0, 255).astype(np.uint8)

    def truth(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return depths of pixels, and which show no edge."""
        inverse = self.inverse_depth()
        x, y = np.rint(2 * pixels).astype(int).T
        window = np.ones((9, 9), np.uint8)
        far, near = cv2.erode(inverse, window)[y, x], cv2.dilate(inverse, window)[y, x]
        return 1 / inverse[y, x], near / far < 1.1

    def inverse_depth(self) -> np.ndarray:
        pose, r = self._pose(0.0, (0, 0, 0)), self.renderer
        nearest = np.full(r.ray_x.shape, 1 / 150, np.float32)
        layers = (nearest, *(np.zeros_like(nearest) for _ in range(3)))
        w = r.world
        for corner, (u, v), lengths, offset in zip(
            w.corners, w.edges, w.lengths, r.offsets_m, strict=True
        ):
            in_camera = pose[:3, :3].T
            at = in_camera @ (corner - pose[:3, 3])
            r._cast_rectangle(at, (in_camera @ u, in_camera @ v), lengths, offset, layers)
        return nearest

    @staticmethod
    def _pose(up_m: float, turn: tuple[float, float, float]) -> np.ndarray:
        pose = np.eye(4)
        turned = Transform.exp(np.array([0, 0, 0, *turn], dtype=float)).matrix()[:3, :3]
        pose[:3, :3], pose[:3, 3] = AHEAD @ turned, EYE_M + np.array([0, 0, up_m])
        return pose


def office() -> World:
    world = World()
    world.add((-1, -3, 0), (7, 0, 0), (0, 6, 0))
    world.add((4.0, -3, 0), (0, 6, 0), (0, 0, 3))
    for side in (-2, 2):
        world.add((-1, side, 0), (7, 0, 0), (0, 0, 3))
    world.add_box((1.8, -0.7, 0), (2.2, -0.2, 0.6))
    world.add_box((2.0, 0.3, 0), (2.4, 0.8, 0.9))
    return world


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene(office())


@pytest.fixture(scope="module")
def pair(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    return scene.picture(), scene.picture(up_m=-BASELINE_M, turn=(0.01, -0.004, 0.006))


@pytest.fixture(scope="module")
def measured(pair: tuple[np.ndarray, np.ndarray]) -> Depth:
    return measure_depth(*pair, camera=CAMERA, baseline_m=BASELINE_M)


@pytest.fixture(scope="module")
def files(pair: tuple[np.ndarray, np.ndarray], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pair")
    for name, picture in zip(("standing", "crouching"), pair, strict=True):
        cv2.imwrite(str(folder / f"{name}.png"), picture)
    return folder


def depth_of(files: Path, *arguments: object, first: str = "standing", second: str = "crouching"):
    pictures = files / f"{first}.png", files / f"{second}.png"
    return call("depth", *pictures, "--fov-deg", FOV_DEG, *arguments)


def test_depths_at_two_metres_are_right_to_two_percent(scene: Scene, measured: Depth):
    assert measured.is_good
    assert len(measured.depth_m) > 150
    true_m, is_flat = scene.truth(measured.pixels)
    near = is_flat & (np.abs(true_m - 2) < 0.5)
    assert near.sum() > 20
    assert np.median(np.abs(measured.depth_m / true_m - 1)[near]) < 0.02
    assert measured.second_from_first is not None
    assert np.linalg.norm(measured.second_from_first.translation_m) == pytest.approx(BASELINE_M)
    np.testing.assert_allclose(
        measured.camera.project(measured.points_m), measured.pixels, atol=1e-6
    )


def test_standard_errors_are_honest():
    ratios = []
    for seed in range(3):
        scene = Scene(office() if seed else room(2.0, np.random.default_rng(1)), seed=seed + 10)
        found = measure_depth(
            scene.picture(), scene.picture(up_m=-BASELINE_M), camera=CAMERA, baseline_m=BASELINE_M
        )
        assert found.is_good
        true_m, is_flat = scene.truth(found.pixels)
        ratios.append(((found.depth_m - true_m) / found.depth_sigma_m)[is_flat])
    ratio = np.abs(np.concatenate(ratios))
    assert 0.2 < np.median(ratio) < 1.2
    assert (ratio > 3).mean() < 0.1


def test_an_uncertain_baseline_makes_uncertain_depths(pair: tuple[np.ndarray, np.ndarray]):
    found = measure_depth(*pair, camera=CAMERA, baseline_m=BASELINE_M, baseline_sigma_m=0.011)
    assert (found.depth_sigma_m >= 0.0999 * found.depth_m).all()
    with pytest.raises(InputError, match="from 0 to less than"):
        measure_depth(*pair, camera=CAMERA, baseline_m=0.1, baseline_sigma_m=0.2)


def test_the_distance_under_a_pixel(scene: Scene, measured: Depth):
    pixels = np.array([[200.0, 330.0], [430.0, 250.0], [320.0, 60.0], [320.0, 430.0]])
    true_m, _ = scene.truth(pixels)
    told = 0
    for pixel, depth_m in zip(pixels, true_m, strict=True):
        found = distance_at(measured, (float(pixel[0]), float(pixel[1])))
        if found.distance_m is None:
            assert found.reason
            continue
        told += 1
        ray = CAMERA.unproject(pixel[None])[0]
        assert found.sigma_m is not None
        assert abs(found.distance_m - depth_m / ray[2]) < max(0.05 * depth_m, 3 * found.sigma_m)
    assert told >= 2
    with pytest.raises(InputError, match="outside the picture"):
        distance_at(measured, (640.0, 100.0))


def test_boxes_on_the_ground_are_obstacles(measured: Depth):
    ground = find_ground(measured, camera_height_m=0.55)
    assert ground is not None
    assert ground.height_m == pytest.approx(0.55, abs=0.03)
    assert find_ground(measured, camera_height_m=2.0) is None
    obstacles = find_obstacles(measured, ground)
    places = [(o.distance_m * math.cos(o.bearing_rad), o.bearing_rad) for o in obstacles]
    assert any(abs(x_m - 1.8) < 0.15 and -0.45 < bearing < -0.05 for x_m, bearing in places)
    assert any(abs(x_m - 2.0) < 0.15 and 0.1 < bearing < 0.5 for x_m, bearing in places)


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("same", "one place"),
        ("turned", "one place"),
        ("blank", "hardly any detail"),
        ("other", "nothing in common"),
    ],
)
def test_what_cannot_be_measured_is_refused_at_once(scene: Scene, kind: str, words: str):
    first = scene.picture()
    if kind == "other":
        second = Scene(room(3.0, np.random.default_rng(8)), seed=77).picture()
    elif kind == "blank":
        first, second = (
            np.clip(scene.random.normal(128, 2, (480, 640)), 0, 255).astype(np.uint8)
            for _ in range(2)
        )
    else:
        second = scene.picture(turn=(0, 0.1, 0)) if kind == "turned" else first
    begin = time.process_time()
    found = measure_depth(first, second, camera=CAMERA, baseline_m=BASELINE_M)
    assert time.process_time() - begin < 2
    assert not found.is_good
    assert words in found.reason
    assert found.remedy
    assert distance_at(found, (10, 10)).reason == found.reason


def test_the_program_writes_a_folder(files: Path, tmp_path: Path):
    out = tmp_path / "depth"
    done = depth_of(files, "--baseline-m", BASELINE_M, "-o", out, "--at", "200,330")
    assert done.exit_code == 0, done.output
    assert "200,330: " in done.output
    assert "points, depth" in said(done)
    summary = summary_of(out)
    assert summary["status"] == "measured"
    assert f", the nearest {summary['obstacles'][0]['distance_m']:.2f} m away, " in said(done)
    table = np.genfromtxt(out / "depth.csv", delimiter=",", names=True)
    assert len(table) == summary["points"] == len(read_ply(out / "points.ply")[0])
    assert (table["depth_m"] <= table["distance_m"] * 1.001).all()
    picture = cv2.imread(str(out / "depth.png"))
    assert picture.shape[0] >= 480
    assert (picture.max(axis=2).astype(int) - picture.min(axis=2) > 100).sum() > 1000
    assert depth_of(files, "--baseline-m", BASELINE_M, "-o", out).exit_code == 2
    again = depth_of(files, "--baseline-m", "0.22", "-o", out, "--overwrite")
    assert again.exit_code == 0
    doubled = summary_of(out)["median_depth_m"] / summary["median_depth_m"]
    assert doubled == pytest.approx(2, abs=0.01)


def test_the_program_says_why_it_refuses(files: Path, tmp_path: Path):
    out = tmp_path / "out"
    done = depth_of(files, "--baseline-m", BASELINE_M, "-o", out, second="standing")
    assert done.exit_code == 1
    assert "one place" in said(done)
    assert summary_of(out)["status"] == "refused"
    assert not (out / "depth.csv").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "baseline-m"),
        (["--baseline-m", "0"], "from 0.001 to 1000"),
        (["--baseline-m", "nan"], "from 0.001 to 1000"),
        (["--baseline-m", "0.1", "--at", "9999,0"], "outside the picture"),
        (["--baseline-m", "0.1", "--at", "nan,0"], "outside the picture"),
        (["--baseline-m", "0.1", "--at", "left"], "must be X,Y"),
        (["--baseline-m", "0.1", "--set", "wings=2"], "unknown key wings"),
        (["--baseline-m", "0.1", "--set", "min_track_length=3"], "must be 2 for two pictures"),
        (["--baseline-m", "0.1", "--camera-height-m", "-1"], "height of the camera"),
    ],
)
def test_misuse_is_named(files: Path, tmp_path: Path, arguments: list[str], words: str):
    done = depth_of(files, *arguments, "-o", tmp_path / "out")
    assert done.exit_code == 2, done.output
    assert words in said(done)
    assert not (tmp_path / "out").exists()


def test_pictures_that_do_not_fit_are_named(files: Path, tmp_path: Path):
    small = files / "small.png"
    cv2.imwrite(str(small), np.zeros((240, 320), np.uint8))
    for second, words in (("small", "320x240"), ("missing", "missing.png")):
        done = depth_of(files, "--baseline-m", BASELINE_M, "-o", tmp_path / "out", second=second)
        assert done.exit_code == 2
        assert words in said(done)


def test_each_picture_is_decoded_once(files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    decoded = []

    def watched(data: bytes, file: Path | str) -> np.ndarray:
        decoded.append(Path(file).stem)
        return decode_grey(data, file)

    monkeypatch.setattr("pilotage.recordings.pictures.decode_grey", watched)
    assert depth_of(files, "--baseline-m", BASELINE_M, "-o", tmp_path / "out").exit_code == 0
    assert decoded == ["standing", "crouching"]
