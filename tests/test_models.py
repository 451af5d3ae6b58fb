# SPDX-License-Identifier: Apache-2.0
"""Reconstructions as values, and as points and trajectories in files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic_models import a_model, bare

from pilotage.errors import InputError
from pilotage.models import read_ply, write_ply, write_tum


def test_ply_holds_points_colours_and_cameras(tmp_path: Path) -> None:
    model = a_model()
    write_ply(tmp_path / "points.ply", model)
    points, colors = read_ply(tmp_path / "points.ply")
    np.testing.assert_allclose(points, model.points_in_world, rtol=1e-6)
    np.testing.assert_array_equal(colors, model.colors)
    write_ply(tmp_path / "with.ply", model, with_cameras=True)
    points, _ = read_ply(tmp_path / "with.ply")
    pyramids = points[len(model.points_in_world) :].reshape(len(model.names), 5, 3)
    np.testing.assert_allclose(pyramids[:, 0], model.world_from_camera()[:, :3, 3], atol=1e-6)
    # The base lies ahead of each camera, as far in front of all as its middle.
    for corners, pose in zip(pyramids, model.camera_from_world, strict=True):
        matrix = pose.matrix()
        depths = (corners[1:] @ matrix[:3, :3].T + matrix[:3, 3])[:, 2]
        assert depths.min() > 0
        np.testing.assert_allclose(depths, depths[0], atol=1e-6)


def test_ply_faces_name_vertices_that_are_there(tmp_path: Path) -> None:
    model = bare(a_model())
    write_ply(tmp_path / "cameras.ply", model, with_cameras=True)
    body = (tmp_path / "cameras.ply").read_bytes().partition(b"end_header\n")[2]
    faces = np.frombuffer(body[25 * 15 :], [("count", "u1"), ("corners", "<i4", 3)])
    assert len(faces) == 5 * 6
    assert set(faces["corners"].ravel().tolist()) == set(range(25))


def test_other_ply_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.ply"
    with pytest.raises(InputError, match="No such file"):
        read_ply(path)
    path.write_text("ply\nformat ascii 1.0\nend_header\n")
    with pytest.raises(InputError, match="not a PLY file"):
        read_ply(path)
    write_ply(path, a_model())
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(InputError, match="cut off"):
        read_ply(path)


def test_tum_is_in_order_of_time(tmp_path: Path) -> None:
    model = a_model()
    write_tum(tmp_path / "tum.txt", model, [4_000_000_000, 1, 2, 3, 5_000_000_000])
    rows = np.loadtxt(tmp_path / "tum.txt")
    np.testing.assert_allclose(rows[:, 0], [1e-9, 2e-9, 3e-9, 4, 5])
    centres = model.world_from_camera()[[1, 2, 3, 0, 4], :3, 3]
    np.testing.assert_allclose(rows[:, 1:4], centres, atol=1e-9)
    with pytest.raises(ValueError, match="argument"):
        write_tum(tmp_path / "tum.txt", model, [1, 2])


def test_reprojection_is_exact_without_noise_and_behind_the_camera_unknown() -> None:
    model = a_model(noise_px=0.0)
    np.testing.assert_allclose(model.reprojection_errors_px(), 0, atol=1e-9)
    behind = model.points_in_world.copy()
    behind[:, 2] *= -1
    assert np.isnan(replace(model, points_in_world=behind).reprojection_errors_px()).all()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"colors": np.zeros((3, 3), np.uint8)}, "colors"),
        ({"names": ("a", "a", "b", "c", "d")}, "two pictures"),
        ({"camera_from_world": ()}, "poses"),
        ({"camera_index": np.array([0, 1, 2, 0, 0])}, "camera_index reaches"),
    ],
)
def test_what_does_not_fit_together_is_refused(change: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        replace(a_model(), **change)
