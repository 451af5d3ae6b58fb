# SPDX-License-Identifier: Apache-2.0
"""COLMAP's files: what is written is read back, and COLMAP reads the same."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic_models import a_model, bare, camera

from pilotage.errors import InputError, RunError
from pilotage.models import (
    Model,
    read_colmap_binary,
    read_colmap_text,
    write_colmap_binary,
    write_colmap_text,
)
from pilotage.models.colmap_tables import CameraRow, Tables, model_of

FORMATS: dict[str, tuple[Callable[[Path, Model], None], Callable[[Path], Model]]] = {
    "text": (write_colmap_text, read_colmap_text),
    "binary": (write_colmap_binary, read_colmap_binary),
}
LENSES = [
    ("none", [], "PINHOLE"),
    ("brown", [-0.28, 0.07, 2e-4, 1e-5], "OPENCV"),
    ("brown", [-0.28, 0.07, 2e-4, 1e-5, 0.01], "FULL_OPENCV"),
    ("kannala_brandt", [-0.01, 0.02, -0.005, 0.001], "OPENCV_FISHEYE"),
]


def sorted_observations(model: Model) -> np.ndarray:
    rows = np.column_stack([model.picture, model.point, model.pixel_px])
    return rows[np.lexsort((model.point, model.picture))]


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize(("distortion", "coefficients"), [lens[:2] for lens in LENSES])
def test_what_is_written_is_read(
    form: str, distortion: str, coefficients: list[float], tmp_path: Path
) -> None:
    model = a_model(camera(distortion, coefficients))
    write, read = FORMATS[form]
    write(tmp_path / "new" / "model", model)
    again = read(tmp_path / "new" / "model")
    assert again.names == model.names
    assert [c.distortion for c in again.cameras] == [c.distortion for c in model.cameras]
    for one, other in zip(again.cameras, model.cameras, strict=True):
        assert (one.width_px, one.height_px) == (other.width_px, other.height_px)
        assert (one.fx_px, one.fy_px, one.cx_px) == (other.fx_px, other.fy_px, other.cx_px)
        assert one.coefficients == other.coefficients
    np.testing.assert_array_equal(again.camera_index, model.camera_index)
    np.testing.assert_array_equal(again.points_in_world, model.points_in_world)
    np.testing.assert_array_equal(again.colors, model.colors)
    np.testing.assert_allclose(again.world_from_camera(), model.world_from_camera(), atol=1e-12)
    np.testing.assert_allclose(sorted_observations(again), sorted_observations(model), atol=1e-9)


@pytest.mark.parametrize("form", FORMATS)
def test_a_model_without_points_is_read(form: str, tmp_path: Path) -> None:
    write, read = FORMATS[form]
    write(tmp_path, bare(a_model()))
    again = read(tmp_path)
    assert len(again.names) == 5
    assert len(again.points_in_world) == len(again.pixel_px) == 0


def pycolmap_model(folder: Path) -> Any:
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap, the yardstick, is not installed")
    return pycolmap.Reconstruction(str(folder))


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize(("distortion", "coefficients", "name"), LENSES)
def test_colmap_sees_the_same(
    form: str, distortion: str, coefficients: list[float], name: str, tmp_path: Path
) -> None:
    model = a_model(camera(distortion, coefficients))
    FORMATS[form][0](tmp_path, model)
    theirs = pycolmap_model(tmp_path)
    assert theirs.cameras[1].model.name == name
    assert theirs.num_reg_images() == len(model.names)
    assert {image.name for image in theirs.images.values()} == set(model.names)
    ours = model.reprojection_errors_px()
    said = {number: point.error for number, point in theirs.points3D.items()}
    theirs.update_point_3d_errors()
    for number, point in theirs.points3D.items():
        mean_px = ours[model.point == number - 1].mean()
        assert point.error == pytest.approx(mean_px, abs=1e-6)
        assert said[number] == pytest.approx(mean_px, abs=1e-9)
        np.testing.assert_array_equal(point.color, model.colors[number - 1])


@pytest.mark.parametrize("form", FORMATS)
def test_what_colmap_writes_is_read(form: str, tmp_path: Path) -> None:
    """It also writes pixels that belong to no point, rigs and frames."""
    model = a_model()
    write_colmap_text(tmp_path / "ours", model)
    theirs = pycolmap_model(tmp_path / "ours")
    theirs.delete_observation(1, 0)
    folder = tmp_path / "theirs"
    folder.mkdir()
    theirs.write_text(str(folder)) if form == "text" else theirs.write_binary(str(folder))
    again = FORMATS[form][1](folder)
    assert sorted(again.names) == sorted(model.names)
    assert len(again.pixel_px) == len(model.pixel_px) - 1
    assert again.reprojection_errors_px().max() == pytest.approx(
        model.reprojection_errors_px().max(), abs=1e-4
    )


def test_the_centre_of_the_first_pixel_is_half_a_pixel_for_colmap(tmp_path: Path) -> None:
    seen_at_origin = replace(
        bare(a_model()),
        points_in_world=np.array([[0.0, 0.0, 5.0]]),
        colors=np.zeros((1, 3), np.uint8),
        picture=np.array([0]),
        point=np.array([0]),
        pixel_px=np.zeros((1, 2)),
    )
    write_colmap_text(tmp_path, seen_at_origin)
    assert "0.5 0.5 1\n" in (tmp_path / "images.txt").read_text()
    assert "PINHOLE 640 480 500.0 510.0 322.0 238.75\n" in (tmp_path / "cameras.txt").read_text()


@pytest.mark.parametrize(
    ("model", "parameters", "distortion", "coefficients"),
    [
        ("SIMPLE_PINHOLE", (500, 320, 240), "none", []),
        ("SIMPLE_RADIAL", (500, 320, 240, -0.1), "brown", [-0.1, 0, 0, 0, 0]),
        ("RADIAL", (500, 320, 240, -0.1, 0.02), "brown", [-0.1, 0.02, 0, 0, 0]),
    ],
)
def test_simpler_cameras_are_read(
    model: str, parameters: tuple[float, ...], distortion: str, coefficients: list[float]
) -> None:
    found = model_of(Tables([CameraRow(7, model, 640, 480, parameters)], [], [])).cameras[0]
    assert (found.fx_px, found.fy_px, found.cx_px, found.cy_px) == (500, 500, 319.5, 239.5)
    assert found.distortion == distortion
    assert found.coefficients == coefficients


def test_a_rational_lens_is_refused() -> None:
    row = CameraRow(1, "FULL_OPENCV", 640, 480, (500, 500, 320, 240, 0, 0, 0, 0, 0, 0.1, 0, 0))
    with pytest.raises(InputError, match="k4 to k6"):
        model_of(Tables([row], [], []))


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin", "points3D.bin"])
def test_binary_files_that_are_cut_off_are_refused(name: str, tmp_path: Path) -> None:
    write_colmap_binary(tmp_path, a_model())
    whole = (tmp_path / name).read_bytes()
    for length in (0, 7, 20, len(whole) // 2, len(whole) - 1):
        (tmp_path / name).write_bytes(whole[:length])
        with pytest.raises(InputError, match=name):
            read_colmap_binary(tmp_path)
    (tmp_path / name).write_bytes(whole + b"\0")
    with pytest.raises(InputError, match="after its end"):
        read_colmap_binary(tmp_path)
    (tmp_path / name).write_bytes(struct.pack("<Q", 2**60) + whole[8:])
    with pytest.raises(InputError, match=name):
        read_colmap_binary(tmp_path)


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("cameras.txt", "1 PINHOLE 640 480 500"),
        ("cameras.txt", "1 UNHEARD 640 480 500 500 320 240"),
        ("images.txt", "1 1 0 0 0 0 0 1 a.jpg\n"),
        ("images.txt", "1 1 0 0 0 0 0 0 1 a.jpg\n1 2"),
        ("points3D.txt", "1 0 0 0 300 0 0 0.5 1 0"),
        ("points3D.txt", "1 0 0 0 30 0 0 0.5 1"),
    ],
)
def test_lines_that_cannot_be_are_refused(name: str, line: str, tmp_path: Path) -> None:
    write_colmap_text(tmp_path, a_model())
    (tmp_path / name).write_text(f"# first\n{line}\n")
    with pytest.raises(InputError, match=f"{name}, line"):
        read_colmap_text(tmp_path)


def test_points_that_are_missing_are_told(tmp_path: Path) -> None:
    write_colmap_text(tmp_path, a_model())
    (tmp_path / "points3D.txt").write_text("")
    with pytest.raises(InputError, match="sees point"):
        read_colmap_text(tmp_path)
    with pytest.raises(InputError, match="cameras"):
        read_colmap_text(tmp_path / "elsewhere")


def test_a_name_that_text_cannot_hold_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    model = a_model()
    with pytest.raises(InputError, match="rename it"):
        write_colmap_text(tmp_path / "model", replace(model, names=("a b", *model.names[1:])))
    assert not (tmp_path / "model").exists()


def test_binary_files_hold_any_name(tmp_path: Path) -> None:
    names = ("left of the door/über 1.jpg", *(f"{i}.jpg" for i in range(4)))
    write_colmap_binary(tmp_path, replace(a_model(), names=names))
    assert read_colmap_binary(tmp_path).names == names
    theirs = pycolmap_model(tmp_path)
    assert {image.name for image in theirs.images.values()} == set(names)


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RunError, match="file"):
        write_colmap_binary(tmp_path / "file" / "model", a_model())
