# SPDX-License-Identifier: Apache-2.0
"""COLMAP's tables as text: cameras.txt, images.txt, points3D.txt."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pilotage.errors import InputError
from pilotage.models.colmap_tables import CAMERA_MODELS, CameraRow, ImageRow, PointRow, Tables
from pilotage.pose_files import read_text

CAMERAS, IMAGES, POINTS = "cameras.txt", "images.txt", "points3D.txt"


def contents(tables: Tables) -> dict[str, str]:
    """Return the text of each file by its name."""
    return {
        CAMERAS: "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n" + _lines(map(_camera, tables.cameras)),
        IMAGES: "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME\n# POINTS2D[] as X Y POINT3D_ID\n"
        + _lines(map(_image, tables.images)),
        POINTS: "# POINT3D_ID X Y Z R G B ERROR TRACK[] as IMAGE_ID POINT2D_IDX\n"
        + _lines(map(_point, tables.points)),
    }


def _lines(rows: Iterable[str]) -> str:
    return "".join(row + "\n" for row in rows)


def _camera(row: CameraRow) -> str:
    size = f"{row.width_px} {row.height_px}"
    return f"{row.identifier} {row.model} {size} {_numbers(row.parameters)}"


def _image(row: ImageRow) -> str:
    if not row.name or any(letter.isspace() for letter in row.name):
        raise InputError(
            f"picture {row.name!r}: COLMAP reads names in text files up to the first space; "
            "rename it, or write the binary files"
        )
    pose = _numbers((*row.quaternion_wxyz, *row.translation))
    pixels = zip(row.pixels.tolist(), row.points.tolist(), strict=True)
    seen = " ".join(f"{_numbers(pixel)} {point}" for pixel, point in pixels)
    return f"{row.identifier} {pose} {row.camera} {row.name}\n{seen}"


def _point(row: PointRow) -> str:
    color = " ".join(map(str, row.color))
    track = " ".join(map(str, row.track.ravel().tolist()))
    position = _numbers((*row.position,))
    return f"{row.identifier} {position} {color} {row.error_px!r} {track}"


def _numbers(values: Iterable[float]) -> str:
    # What is read back is the same to the last bit.
    return " ".join(repr(float(value)) for value in values)


def read(folder: Path) -> Tables:
    """Read the three files. InputError names the file and the line."""
    return Tables(
        cameras=[_parsed_camera(row) for row in _rows(folder / CAMERAS)],
        images=_read_images(folder / IMAGES),
        points=[_parsed_point(row) for row in _rows(folder / POINTS)],
    )


class _Row:
    """A line and where it stands; what cannot be parsed raises InputError saying so."""

    def __init__(self, path: Path, number: int, line: str) -> None:
        self.text = line.strip()
        self._where = f"{path}, line {number}"

    def __enter__(self) -> str:
        return self.text

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        if isinstance(error, (ValueError, IndexError, OverflowError)):
            raise InputError(f"{self._where}: not what COLMAP writes there") from error


def _rows(path: Path, *, keep_empty: bool = False) -> Iterator[_Row]:
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        if not line.startswith("#") and (keep_empty or line.strip()):
            yield _Row(path, number, line)


def _parsed_camera(row: _Row) -> CameraRow:
    with row as text:
        identifier, model, width, height, *parameters = text.split()
        if len(parameters) != CAMERA_MODELS.get(model, (0, -1))[1]:
            raise ValueError(model)
        values = tuple(float(value) for value in parameters)
        return CameraRow(int(identifier), model, int(width), int(height), values)


def _read_images(path: Path) -> list[ImageRow]:
    rows = list(_rows(path, keep_empty=True))
    while len(rows) % 2 and not rows[-1].text:
        rows.pop()
    if len(rows) % 2:
        raise InputError(f"{path}: ends within an image; two lines are written for each")
    return [_parsed_image(*pair) for pair in zip(rows[::2], rows[1::2], strict=True)]


def _parsed_image(first: _Row, second: _Row) -> ImageRow:
    with first as text:
        identifier, *pose, camera, name = text.split(maxsplit=9)
        values = tuple(float(value) for value in pose)
        if len(values) != 7:
            raise ValueError(text)
    with second as text:
        seen: NDArray[np.float64] = np.array(text.split(), dtype=np.float64).reshape(-1, 3)
    return ImageRow(
        identifier=int(identifier),
        quaternion_wxyz=values[:4],
        translation=values[4:],
        camera=int(camera),
        name=name,
        pixels=seen[:, :2],
        points=seen[:, 2].astype(np.int64),
    )


def _parsed_point(row: _Row) -> PointRow:
    with row as text:
        cells = text.split()
        track = np.array(cells[8:], dtype=np.int64).reshape(-1, 2)
        position = tuple(float(value) for value in cells[1:4])
        color = tuple(int(value) for value in cells[4:7])
        if not all(0 <= value <= 255 for value in color):
            raise ValueError(text)
        return PointRow(int(cells[0]), position, color, float(cells[7]), track)
