# SPDX-License-Identifier: Apache-2.0
"""COLMAP's tables as bytes, little-endian: cameras.bin, images.bin, points3D.bin."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np

from pilotage.errors import InputError
from pilotage.models.colmap_tables import CAMERA_MODELS, CameraRow, ImageRow, PointRow, Tables

CAMERAS, IMAGES, POINTS = "cameras.bin", "images.bin", "points3D.bin"
COUNT = struct.Struct("<Q")
CAMERA = struct.Struct("<IiQQ")  # identifier, model, width, height
IMAGE = struct.Struct("<I7dI")  # identifier, quaternion, translation, camera
POINT = struct.Struct("<Q3d3BdQ")  # identifier, position, colour, error, length of the track
# -1 stands for no point; COLMAP writes the same bits without a sign.
PIXEL = np.dtype([("xy", "<f8", 2), ("point", "<i8")])
TRACK = np.dtype("<u4")
MODEL_OF_NUMBER = {number: name for name, (number, _) in CAMERA_MODELS.items()}


def contents(tables: Tables) -> dict[str, bytes]:
    """Return the bytes of each file by its name."""
    return {
        CAMERAS: COUNT.pack(len(tables.cameras)) + b"".join(map(_camera, tables.cameras)),
        IMAGES: COUNT.pack(len(tables.images)) + b"".join(map(_image, tables.images)),
        POINTS: COUNT.pack(len(tables.points)) + b"".join(map(_point, tables.points)),
    }


def _camera(row: CameraRow) -> bytes:
    number, count = CAMERA_MODELS[row.model]
    head = CAMERA.pack(row.identifier, number, row.width_px, row.height_px)
    return head + struct.pack(f"<{count}d", *row.parameters)


def _image(row: ImageRow) -> bytes:
    if "\0" in row.name:
        raise InputError(f"picture {row.name!r}: a name cannot hold a zero byte; rename it")
    head = IMAGE.pack(row.identifier, *row.quaternion_wxyz, *row.translation, row.camera)
    seen = np.empty(len(row.points), PIXEL)
    seen["xy"], seen["point"] = row.pixels, row.points
    return head + row.name.encode() + b"\0" + COUNT.pack(len(seen)) + seen.tobytes()


def _point(row: PointRow) -> bytes:
    head = POINT.pack(row.identifier, *row.position, *row.color, row.error_px, len(row.track))
    return head + row.track.astype(TRACK).tobytes()


def read(folder: Path) -> Tables:
    """Read the three files. InputError names one that is cut off or holds something else."""
    with _Bytes(folder / CAMERAS) as cameras:
        camera_rows = [_read_camera(cameras) for _ in range(cameras.take(COUNT)[0])]
    with _Bytes(folder / IMAGES) as images:
        image_rows = [_read_image(images) for _ in range(images.take(COUNT)[0])]
    with _Bytes(folder / POINTS) as points:
        point_rows = [_read_point(points) for _ in range(points.take(COUNT)[0])]
    return Tables(camera_rows, image_rows, point_rows)


class _Bytes:
    """A file read from the front; whatever cannot be there raises InputError naming it."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._at = 0
        try:
            self._content = path.read_bytes()
        except OSError as error:
            raise InputError(f"{path}: {error.strerror or error}") from error

    def take(self, layout: struct.Struct) -> tuple[Any, ...]:
        """Return the next values."""
        values = layout.unpack_from(self._content, self._at)
        self._at += layout.size
        return values

    def take_array(self, dtype: np.dtype[Any], count: int) -> Any:
        """Return the next array."""
        if count * dtype.itemsize > len(self._content) - self._at:
            raise ValueError(count)
        values = np.frombuffer(self._content, dtype, count, self._at)
        self._at += values.nbytes
        return values

    def take_name(self) -> str:
        """Return the text up to the next zero byte."""
        end = self._content.index(b"\0", self._at)
        name = self._content[self._at : end].decode()
        self._at = end + 1
        return name

    def __enter__(self) -> _Bytes:
        return self

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        if isinstance(error, (struct.error, ValueError, KeyError)):
            said = f"{self._path}: not what COLMAP writes there, byte {self._at}"
            raise InputError(said) from error
        if error is None and self._at != len(self._content):
            raise InputError(f"{self._path}: goes on after its end, byte {self._at}")


def _read_camera(data: _Bytes) -> CameraRow:
    identifier, number, width, height = data.take(CAMERA)
    model = MODEL_OF_NUMBER[number]
    values = data.take(struct.Struct(f"<{CAMERA_MODELS[model][1]}d"))
    return CameraRow(identifier, model, width, height, values)


def _read_image(data: _Bytes) -> ImageRow:
    values = data.take(IMAGE)
    name = data.take_name()
    seen = data.take_array(PIXEL, data.take(COUNT)[0])
    return ImageRow(
        identifier=values[0],
        quaternion_wxyz=values[1:5],
        translation=values[5:8],
        camera=values[8],
        name=name,
        pixels=seen["xy"],
        points=seen["point"].astype(np.int64),
    )


def _read_point(data: _Bytes) -> PointRow:
    values = data.take(POINT)
    track = data.take_array(TRACK, 2 * values[8]).reshape(-1, 2).astype(np.int64)
    return PointRow(values[0], values[1:4], values[4:7], values[7], track)
