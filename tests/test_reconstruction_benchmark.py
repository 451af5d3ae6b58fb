# SPDX-License-Identifier: Apache-2.0
"""The benchmark of reconstructions in small: its sets are read right, its judgement is right."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic_models import a_model, camera

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"
sys.path.insert(0, str(BENCHMARKS))

import office_walk  # noqa: E402
from picture_sets import PictureSet, euroc, lund, strecha  # noqa: E402
from reconstruction import (  # noqa: E402
    judged,
    matrices,
    measure,
    poses_by_place,
    read_rows,
    shuffled_files,
    shuffled_mm,
    table,
    with_ratios,
)
from run_reconstruction import MissingSystemError, Options, run_ours  # noqa: E402

from pilotage import Camera  # noqa: E402
from pilotage.models import write_colmap_text  # noqa: E402


def a_path(count: int = 12, seed: int = 1) -> np.ndarray:
    random = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(random.normal(0, 0.2, (count, 3))).as_matrix()
    poses[:, :3, 3] = np.cumsum(random.normal(0, 0.4, (count, 3)), axis=0)
    return poses


def rows_of(poses: np.ndarray) -> list[list[float] | None]:
    return [pose[:3].ravel().tolist() if np.isfinite(pose).all() else None for pose in poses]


def a_set(truth: np.ndarray) -> PictureSet:
    pictures = tuple(Path(f"{i}.png") for i in range(len(truth)))
    return PictureSet("a_set", pictures, camera(), truth)


def a_row(**known: Any) -> dict[str, Any]:
    return {"set": "a_set", "system": "colmap", "shuffle": None, "threads": 2, **known}


def test_poses_are_found_by_the_names_of_files() -> None:
    model = a_model()
    files = [Path("x") / f"{i}.jpg" for i in (3, 9, 0)]
    poses = matrices(poses_by_place(model, files))
    np.testing.assert_allclose(poses[[0, 2]], model.world_from_camera()[[3, 0]])
    assert np.isnan(poses[1]).all()
    assert np.isnan(matrices(poses_by_place(None, files))).all()


def test_errors_are_metric_and_what_is_missing_shows() -> None:
    truth = a_path()
    estimate = truth.copy()
    estimate[:, :3, 3] = 0.1 * truth[:, :3, 3] + (1, 2, 3)
    estimate[4] = np.nan
    row = judged(a_row(poses=rows_of(estimate)), a_set(truth))
    assert row["registered"] == "11/12"
    assert row["ate_rmse_m"] < 1e-9
    assert row["scale"] == pytest.approx(10)
    nothing = judged(a_row(poses=[None] * 12), a_set(truth))
    assert nothing["registered"] == "0/12"
    assert "ate_rmse_m" not in nothing


def test_shuffled_runs_are_compared_in_true_millimetres() -> None:
    truth = a_path()
    plain = truth.copy()
    plain[:, :3, 3] *= 0.5
    other = plain.copy()
    other[:, :3, 3] = 7 * plain[:, :3, 3]
    pictures = a_set(truth)
    one, two = (judged(a_row(poses=rows_of(poses)), pictures) for poses in (plain, other))
    assert shuffled_mm(two, one) == pytest.approx(0, abs=1e-9)
    other[:, 2, 3] += 7 * 0.01 * np.resize((1, -1), len(other))
    off_mm = shuffled_mm(judged(a_row(poses=rows_of(other)), pictures), one)
    assert off_mm == pytest.approx(20, rel=0.1)
    assert math.isnan(shuffled_mm(a_row(note="failed"), one))


def test_files_are_shuffled_by_their_names_and_keep_their_places(tmp_path: Path) -> None:
    files = [tmp_path / f"{i}.JPG" for i in range(20)]
    for i, path in enumerate(files):
        path.write_text(str(i))
    copies = shuffled_files(files, 3, tmp_path)
    assert [path.read_text() for path in copies] == [str(i) for i in range(20)]
    assert sorted(copies) != copies
    again = shuffled_files(files, 3, tmp_path)
    assert again == copies


def test_table_compares_the_same_pictures() -> None:
    rows = [
        a_row(cpu_s=60.0, registered="12/12"),
        a_row(system="pilotage", cpu_s=6.0),
        a_row(system="pilotage", cpu_s=5.0, shuffle=1),
    ]
    assert [row["cpu_ratio"] for row in with_ratios(rows)[1:]] == pytest.approx(
        [10, math.nan], nan_ok=True
    )
    text = table(rows)
    assert "a_set, shuffled 1" in text
    assert "12/12" in text


def test_rows_that_an_interrupt_cut_off_are_left_out(tmp_path: Path) -> None:
    out = tmp_path / "rows.jsonl"
    assert read_rows(out) == []
    out.write_text(json.dumps(a_row()) + "\n" + json.dumps(a_row())[:20])
    assert read_rows(out) == [a_row()]


def test_pilotage_may_say_why_there_is_no_model(monkeypatch: pytest.MonkeyPatch) -> None:
    name, model, files = "pilotage.behaviors.reconstruct", a_model(), [Path("a.png")]
    options = Options(is_ordered=True, matches_all=False, threads=2)
    for said, wanted in (
        (model, (model, "")),
        (SimpleNamespace(model=None, reason="no_parallax"), (None, "no_parallax")),
    ):
        fake = SimpleNamespace(reconstruct=lambda pictures, *, camera, ordered, said=said: said)
        monkeypatch.setitem(sys.modules, name, fake)
        assert run_ours(files, camera(), options, Path())() == wanted
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingSystemError, match="pilotage"):
        run_ours(files, camera(), options, Path())


def full_and_half(point: np.ndarray, full: tuple[float, float, float, float]) -> np.ndarray:
    """Return where a picture of half the size shows a point, of its full fx fy cx cy."""
    fx, fy, cx, cy = full
    seen = np.array([fx * point[0] / point[2] + cx, fy * point[1] / point[2] + cy])
    return (seen + 0.5) / 2 - 0.5


def test_strecha_is_halved(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    (tmp_path / "truth_cameras").mkdir()
    (tmp_path / "images" / "0000.jpg").touch()
    (tmp_path / "truth_cameras" / "0000.jpg.camera").write_text(
        "2759 0 1520 \n0 2764 1006 \n0 0 1 \n0 0 0\n0 -1 0\n1 0 0\n0 0 1\n4 5 6\n3072 2048\n"
    )
    found = strecha(tmp_path, tmp_path)
    assert (found.camera.width_px, found.camera.height_px) == (1536, 1024)
    point = np.array([0.3, -0.2, 2.0])
    expected = full_and_half(point, (2759, 2764, 1520, 1006))
    np.testing.assert_allclose(found.camera.project(point[None])[0], expected)
    np.testing.assert_allclose(found.truth[0, :3], [[0, -1, 0, 4], [1, 0, 0, 5], [0, 0, 1, 6]])


def test_lund_is_halved_and_put_in_the_order_of_its_files(tmp_path: Path) -> None:
    model = a_model()
    write_colmap_text(tmp_path / "colmap_reference", model)
    images = tmp_path / "colmap_reference" / "images.txt"
    images.write_text(images.read_text().replace(".jpg", ".JPG"))
    (tmp_path / "images").mkdir()
    for i in (4, 2):
        (tmp_path / "images" / f"{i}.JPG").touch()
    found = lund(tmp_path, tmp_path)
    np.testing.assert_allclose(found.truth, model.world_from_camera()[[2, 4]], atol=1e-9)
    whole = model.cameras[0]
    point = np.array([0.3, -0.2, 2.0])
    expected = full_and_half(point, (whole.fx_px, whole.fy_px, whole.cx_px, whole.cy_px))
    np.testing.assert_allclose(found.camera.project(point[None])[0], expected)


def test_euroc_truth_is_that_of_the_camera(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    for time_ns in (1_000_000_000, 1_050_000_000):
        (tmp_path / "images" / f"{time_ns}_0.jpg").touch()
        (tmp_path / "images" / f"{time_ns}_1.jpg").touch()
    (tmp_path / "cam0_sensor.yaml").write_text(
        "%YAML:1.0\nT_BS:\n  cols: 4\n  rows: 4\n"
        "  data: [0, 0, 1, 0.1, -1, 0, 0, 0.2, 0, -1, 0, 0.3, 0, 0, 0, 1]\n"
        "resolution: [752, 480]\nintrinsics: [458.654, 457.296, 367.215, 248.375]\n"
        "distortion_coefficients: [-0.28, 0.07, 0.0002, 1e-05]\n"
    )
    lines = [f"{time_s:.2f} {time_s - 1:g} 0 0 0 0 0 1" for time_s in (1.0, 1.1)]
    (tmp_path / "truth_body_tum.txt").write_text("\n".join(lines) + "\n")
    found = euroc(tmp_path, tmp_path)
    assert len(found.pictures) == 2
    np.testing.assert_allclose(found.truth[:, :3, 3], [[0.1, 0.2, 0.3], [0.15, 0.2, 0.3]])
    assert found.camera.coefficients[:2] == [-0.28, 0.07]


def seen_in_a_corner(lens: Camera, world_from_camera: np.ndarray) -> np.ndarray:
    """Return the picture of a wall at z = 5 and a floor at y = 1, rough at all sizes."""
    random = np.random.default_rng(8)
    sizes = (128, 64, 32, 16)
    noise = sum(cv2.resize(random.random((n, n), np.float32), (1024, 1024)) for n in sizes)
    y, x = np.mgrid[: lens.height_px, : lens.width_px]
    rays = np.stack(
        [(x - lens.cx_px) / lens.fx_px, (y - lens.cy_px) / lens.fy_px, np.ones(x.shape)], axis=2
    )
    rays, centre = rays @ world_from_camera[:3, :3].T, world_from_camera[:3, 3]
    far = (5 - centre[2]) / rays[..., 2]
    with np.errstate(divide="ignore"):
        down = np.where(rays[..., 1] > 0, (1 - centre[1]) / rays[..., 1], np.inf)
    hits = centre + np.minimum(far, down)[..., None] * rays
    across = np.where(down < far, hits[..., 2] + 20, hits[..., 1])
    place = [100 * np.float32(v) % 1024 for v in (hits[..., 0] + 30, across)]
    seen = cv2.remap(noise, *place, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return np.clip(64 * seen, 0, 255).astype(np.uint8)


def corner_set(folder: Path) -> PictureSet:
    """Return six pictures taken while going sideways and turning a little."""
    lens = Camera(width_px=240, height_px=180, fx_px=195.0, fy_px=195.0, cx_px=119.5, cy_px=89.5)
    poses = np.tile(np.eye(4), (6, 1, 1))
    turns = np.linspace(-0.1, 0.1, 6)[:, None] * (0.3, 1, 0.2)
    poses[:, :3, :3] = Rotation.from_rotvec(turns).as_matrix()
    poses[:, :3, 3] = np.linspace(-0.8, 0.8, 6)[:, None] * (1, 0.1, 0.3)
    for i, pose in enumerate(poses):
        cv2.imwrite(str(folder / f"{i}.png"), seen_in_a_corner(lens, pose))
    return PictureSet("corner", tuple(folder / f"{i}.png" for i in range(6)), lens, poses)


@pytest.mark.parametrize(("system", "shuffles"), [("colmap", (None, 1)), ("colmap-global", (1,))])
def test_colmap_reconstructs_a_small_set(
    system: str, shuffles: tuple[int | None, ...], tmp_path: Path
) -> None:
    pytest.importorskip("pycolmap", reason="pycolmap, the yardstick, is not installed")
    found = corner_set(tmp_path)
    rows = [measure(found, system, shuffle=shuffle, threads=2) for shuffle in shuffles]
    for row in rows:
        assert row["registered"] == "6/6"
        assert row["ate_rmse_m"] < 0.01
        assert row["rotation_median_deg"] < 0.2
        assert row["cpu_s"] > 0
        assert row["peak_mb"] > 10
    assert ("off unshuffled" in table(rows)) == (len(shuffles) > 1)


def test_the_office_walk_is_made_once(tmp_path: Path) -> None:
    plan = office_walk.WalkPlan(pictures=3, width_px=160, path="straight-1m")
    pictures, lens, truth = office_walk.made_once(tmp_path, plan)
    assert [path.name for path in pictures] == ["000.png", "001.png", "002.png"]
    assert cv2.imread(str(pictures[2])).shape == (120, 160, 3)
    assert (lens.width_px, lens.distortion) == (160, "brown")
    assert truth.shape == (3, 4, 4)
    made = [path.stat().st_mtime_ns for path in pictures]
    office_walk.made_once(tmp_path, plan)
    assert [path.stat().st_mtime_ns for path in pictures] == made
