# SPDX-License-Identifier: Apache-2.0
"""Structure from motion of rendered pictures, against the truth; what cannot be solved is said."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
from program import call, said, summary_of
from rendering import PinholeCamera, Renderer, room
from synthetic import ROBOT_FROM_CAMERA

from pilotage import Camera, PictureFate, ReconstructionConfig
from pilotage.behaviors.reconstruct import Reconstructed, reconstruct
from pilotage.evaluation.camera_poses import pose_errors
from pilotage.models import read_colmap_binary

WIDTH, HEIGHT, FOCAL = 480, 360, 420.0
LENS = (-0.12, 0.04, 0.0005, -0.0005, 0.0)
CAMERA = Camera(
    width_px=WIDTH, height_px=HEIGHT, fx_px=FOCAL, fy_px=FOCAL, cx_px=241.0, cy_px=178.0,
    distortion="brown", coefficients=list(LENS),
)  # fmt: skip
CALIBRATION = f"""\
width_px: {WIDTH}
height_px: {HEIGHT}
fx_px: {FOCAL}
fy_px: {FOCAL}
cx_px: 241.0
cy_px: 178.0
distortion: brown
coefficients: {{k1: {LENS[0]}, k2: {LENS[1]}, p1: {LENS[2]}, p2: {LENS[3]}, k3: 0.0}}
"""


@dataclass(frozen=True)
class Walk:
    """Pictures of a room and where they were taken, (N, 4, 4)."""

    pictures: tuple[Path, ...]
    world_from_camera: np.ndarray


def pose(x: float, y: float, yaw_deg: float) -> np.ndarray:
    """Return a camera 1.2 m above the floor that looks along `yaw_deg`."""
    yaw = np.radians(yaw_deg)
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    world_from_camera = np.eye(4)
    world_from_camera[:3, :3] = turn @ ROBOT_FROM_CAMERA
    world_from_camera[:3, 3] = x, y, 1.2 + 0.02 * np.sin(9 * x)
    return world_from_camera


def take(folder: Path, poses: list[np.ndarray], seed: int = 3) -> Walk:
    """Write noisy pictures of a room from these poses."""
    rng = np.random.default_rng(seed)
    camera = PinholeCamera(WIDTH, HEIGHT, FOCAL, FOCAL, 241.0, 178.0, LENS)
    renderer = Renderer(room(3.0, rng), camera, seed)
    folder.mkdir(parents=True)
    files = []
    for i, world_from_camera in enumerate(poses):
        grey = renderer.render(world_from_camera) + rng.normal(0, 1.5, (HEIGHT, WIDTH))
        files.append(folder / f"{i:03}.png")
        cv2.imwrite(str(files[-1]), np.clip(grey, 0, 255).astype(np.uint8))
    return Walk(tuple(files), np.array(poses))


@pytest.fixture(scope="session")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Walk:
    """Ten pictures along a curve of 2 m."""
    steps = np.linspace(0, 1, 10)
    poses = [pose(0.3 * np.sin(3 * t), 1.0 - 2 * t, 12 * t - 6) for t in steps]
    return take(tmp_path_factory.mktemp("walk") / "pictures", poses)


@pytest.fixture(scope="session")
def model(walk: Walk) -> Reconstructed:
    """The model of that walk."""
    return reconstruct(walk.pictures, camera=CAMERA)


def test_every_picture_of_a_walk_is_posed_to_a_millimetre(walk: Walk, model: Reconstructed):
    assert model.is_whole
    assert model.model.names == tuple(file.name for file in walk.pictures)
    errors = pose_errors(estimate=model.model.world_from_camera(), truth=walk.world_from_camera)
    assert errors is not None
    assert errors.ate_rmse_m < 0.001
    assert errors.rotation_max_deg < 0.05
    assert len(model.model.points_in_world) > 500
    assert np.nanmedian(model.model.reprojection_errors_px()) < 0.2


def test_lengths_have_no_unit_but_ratios_are_right(walk: Walk, model: Reconstructed):
    found = model.model.world_from_camera()[:, :3, 3]
    ratios = np.linalg.norm(np.diff(found, axis=0), axis=1) / np.linalg.norm(
        np.diff(walk.world_from_camera[:, :3, 3], axis=0), axis=1
    )
    np.testing.assert_allclose(ratios, np.median(ratios), rtol=0.01)


@pytest.mark.parametrize("ordered", [True, False])
def test_the_order_of_the_pictures_changes_nothing(walk: Walk, model: Reconstructed, ordered: bool):
    order = np.random.default_rng(5).permutation(len(walk.pictures))
    mixed = reconstruct([walk.pictures[i] for i in order], camera=CAMERA, ordered=ordered).model
    back = np.argsort(order)
    there = mixed.world_from_camera()[back]
    relative = np.linalg.inv(there[0]) @ there
    expected = model.model.world_from_camera()
    np.testing.assert_allclose(relative, np.linalg.inv(expected[0]) @ expected, atol=1e-9)


def test_threads_change_no_bit(walk: Walk, model: Reconstructed):
    one = reconstruct(
        walk.pictures, camera=CAMERA, config=ReconstructionConfig.from_dict({"threads": 1})
    )
    np.testing.assert_array_equal(one.model.points_in_world, model.model.points_in_world)
    np.testing.assert_array_equal(one.model.world_from_camera(), model.model.world_from_camera())


def test_a_turn_on_the_spot_is_no_model(tmp_path: Path):
    turn = take(tmp_path / "turn", [pose(0.0, 0.0, yaw) for yaw in (-14, -7, 0, 7, 14)])
    found = reconstruct(turn.pictures, camera=CAMERA)
    assert found.model.names == ()
    assert set(found.fates) == {PictureFate.no_parallax}


@pytest.mark.parametrize("noise", [1.5, 4.0])
def test_blank_walls_and_single_pictures_are_no_model(walk: Walk, tmp_path: Path, noise: float):
    rng = np.random.default_rng(1)
    blank = []
    for i in range(3):
        blank.append(tmp_path / f"{i}.png")
        wall = np.clip(rng.normal(128, noise, (HEIGHT, WIDTH)), 0, 255)
        cv2.imwrite(str(blank[-1]), wall.astype(np.uint8))
    found = reconstruct(blank, camera=CAMERA)
    assert (found.model.names, set(found.fates)) == ((), {PictureFate.few_features})
    assert reconstruct(walk.pictures[:1], camera=CAMERA).model.names == ()
    assert reconstruct([walk.pictures[0], blank[0]], camera=CAMERA).model.names == ()


def test_a_picture_of_another_place_is_left_out_and_named(walk: Walk, tmp_path: Path):
    pictures = tmp_path / "pictures"
    shutil.copytree(walk.pictures[0].parent, pictures)
    other = take(tmp_path / "other", [pose(0.3, 0.2, 40)], seed=8)
    shutil.copy(other.pictures[0], pictures / "stranger.png")
    (pictures / "camera.yaml").write_text(CALIBRATION)
    done = call("reconstruct", pictures, "-o", tmp_path / "out", "--no-report")
    assert done.exit_code == 0, done.output
    assert "10 of 11 pictures placed" in said(done)
    assert "stranger.png: shows nothing that another picture shows" in said(done)
    summary = summary_of(tmp_path / "out")
    assert (summary["posed"], list(summary["without_pose"])) == (10, ["stranger.png"])
    assert summary["verdict"].startswith("partial")
    kept = read_colmap_binary(tmp_path / "out" / "colmap_binary")
    assert "stranger.png" not in kept.names
    assert len(kept.points_in_world) == summary["points"]


def test_no_model_is_a_failure_with_its_reason(tmp_path: Path):
    turn = take(tmp_path / "turn", [pose(0.0, 0.0, yaw) for yaw in (-8, 0, 8)])
    (tmp_path / "camera.yaml").write_text(CALIBRATION)
    calibration = ("--calibration", tmp_path / "camera.yaml")
    where = ("-o", tmp_path / "out", "--no-report")
    done = call("reconstruct", turn.pictures[0].parent, *where, *calibration)
    assert done.exit_code == 1
    assert "no model" in said(done).lower()
    assert said(done).count("move it sideways") == 1  # not once for each picture
    assert not (tmp_path / "out" / "points.ply").exists()


def test_bad_input_is_named_with_its_remedy(walk: Walk, tmp_path: Path):
    pictures, out = walk.pictures[0].parent, ("-o", tmp_path / "out")
    (tmp_path / "empty").mkdir()
    small = tmp_path / "small"
    shutil.copytree(pictures, small)
    cv2.imwrite(str(small / "003.png"), np.zeros((100, 120), np.uint8))
    cut = tmp_path / "cut"
    shutil.copytree(pictures, cut)
    (cut / "002.png").write_bytes((cut / "002.png").read_bytes()[:900])
    for arguments, message in (
        ((tmp_path / "empty", "--fov-deg", 60), "holds no pictures"),
        ((pictures,), "give --calibration, or --fov-deg"),
        ((pictures, "--fov-deg", 400), "must be from 1 to 150"),
        ((small, "--fov-deg", 60), "003.png: 120x100 pixels, its camera has 480x360"),
        ((cut, "--fov-deg", 60), "002.png"),
        ((pictures, "--fov-deg", 60, "--set", "featurs=3"), "did you mean features?"),
        ((pictures, "--fov-deg", 60, "--set", "features=3"), "features = 3: must be"),
        ((pictures, "--fov-deg", 60, "--set", "min_track_length=12"), "give more, or --set min_tr"),
        (
            (pictures, "--fov-deg", 60, "--set", "uses_dog=false", "--set", "uses_harris=false"),
            "--set uses_harris=false: one of uses_dog, uses_harris, uses_fast_hessian, uses_mser",
        ),
    ):
        done = call("reconstruct", *arguments, *out)
        assert (done.exit_code, message in said(done)) == (2, True), done.output
