# SPDX-License-Identifier: Apache-2.0
"""Coloured points as a PLY file (binary, little-endian), which 3D viewers open."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pilotage import Camera
from pilotage.atomic_files import write_atomically
from pilotage.errors import InputError
from pilotage.models.model import Model

VERTEX = np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)])
FACE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])
VERTEX_PROPERTIES = (
    *("property float x", "property float y", "property float z"),
    *("property uchar red", "property uchar green", "property uchar blue"),
)
# A pyramid: the centre of projection, then the picture's corners, clockwise.
SIDES = ((0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 1), (1, 3, 2), (1, 4, 3))
PYRAMID_COLOR = (230, 60, 40)
# Its depth, of the median distance of a camera to its nearest neighbour.
PYRAMID_SHARE = 0.4


def write_ply(path: Path, model: Model, *, with_cameras: bool = False) -> None:
    """Write the points, and on request a little pyramid for each picture, its base the picture.

    RunError when the file cannot be written.
    """
    points = _vertices(model.points_in_world, model.colors)
    if not with_cameras or not model.names:
        write_atomically(path, _ply(points))
        return
    corners, faces = _pyramids(model, first=len(points))
    write_atomically(path, _ply(np.concatenate([points, corners]), faces))


def ply_bytes(points: NDArray[np.floating[Any]], colors: NDArray[np.uint8]) -> bytes:
    """Return the file of (N, 3) points and their (N, 3) colours: red, green, blue."""
    return _ply(_vertices(points, colors))


def _vertices(points: NDArray[np.floating[Any]], colors: NDArray[np.uint8]) -> NDArray[np.void]:
    vertices = np.empty(len(points), VERTEX)
    vertices["xyz"], vertices["rgb"] = points, colors
    return vertices


def _ply(vertices: NDArray[np.void], faces: NDArray[np.void] | None = None) -> bytes:
    header = ["ply", "format binary_little_endian 1.0"]
    header += [f"element vertex {len(vertices)}", *VERTEX_PROPERTIES]
    if faces is not None:
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    body = vertices.tobytes() + (b"" if faces is None else faces.tobytes())
    return "\n".join([*header, "end_header\n"]).encode("ascii") + body


def _pyramids(model: Model, first: int) -> tuple[NDArray[np.void], NDArray[np.void]]:
    """Return vertices and faces; `first` is the number of the first vertex."""
    vertices = np.empty((len(model.names), 5), VERTEX)
    vertices["xyz"], vertices["rgb"] = pyramid_corners(model), PYRAMID_COLOR
    faces = np.empty((len(vertices), len(SIDES)), FACE)
    faces["count"] = 3
    faces["corners"] = first + 5 * np.arange(len(vertices))[:, None, None] + np.array(SIDES)
    return vertices.ravel(), faces.ravel()


def pyramid_corners(model: Model, *, least_depth: float = 0.0) -> NDArray[np.float64]:
    """Return (P, 5, 3) in the world: of each picture the centre of projection and its corners.

    The pyramids suit the distances of the cameras, but are not less deep than `least_depth`.
    """
    poses = model.world_from_camera()
    depth = max(PYRAMID_SHARE * _spacing(poses[:, :3, 3]), least_depth)
    corners = np.empty((len(poses), 5, 3))
    for i, world_from_camera in enumerate(poses):
        points_in_camera = depth * _pyramid(model.camera_of(i))
        corners[i] = points_in_camera @ world_from_camera[:3, :3].T + world_from_camera[:3, 3]
    return corners


def _pyramid(camera: Camera) -> NDArray[np.float64]:
    """Return (5, 3): the centre and the picture's corners at depth 1; the lens is left out."""
    left, right = -0.5 - camera.cx_px, camera.width_px - 0.5 - camera.cx_px
    top, bottom = -0.5 - camera.cy_px, camera.height_px - 0.5 - camera.cy_px
    corners = [(left, top), (right, top), (right, bottom), (left, bottom)]
    rays = [(x / camera.fx_px, y / camera.fy_px, 1.0) for x, y in corners]
    return np.array([(0.0, 0.0, 0.0), *rays])


def _spacing(centres: NDArray[np.float64]) -> float:
    """Return the median distance of (P, 3) to the nearest other; 1 where there is none."""
    distances = np.linalg.norm(centres[:, None] - centres, axis=2)
    np.fill_diagonal(distances, np.inf)
    spacing = float(np.median(distances.min(axis=1)))
    return spacing if np.isfinite(spacing) and spacing > 0 else 1.0


def read_ply(path: Path) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Return the vertices (N, 3) of a file that `write_ply` wrote, and their colours (N, 3).

    InputError names a file that is no such file.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from error
    head, end, body = content.partition(b"end_header\n")
    lines = head.decode("latin-1").splitlines()
    counts = [line.split()[-1] for line in lines if line.startswith("element vertex ")]
    is_ours = lines[:2] == ["ply", "format binary_little_endian 1.0"] and end
    if not is_ours or len(counts) != 1 or tuple(lines[3:9]) != VERTEX_PROPERTIES:
        raise InputError(f"{path}: not a PLY file of coloured points as Pilotage writes them")
    count = int(counts[0]) if counts[0].isdecimal() else 0
    if len(body) < count * VERTEX.itemsize:
        raise InputError(f"{path}: cut off; {count} points are announced")
    vertices = np.frombuffer(body, VERTEX, count=count)
    return vertices["xyz"].copy(), vertices["rgb"].copy()
