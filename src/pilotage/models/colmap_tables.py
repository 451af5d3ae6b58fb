# SPDX-License-Identifier: Apache-2.0
"""COLMAP's three tables, and how a model becomes them and back; how they are written is elsewhere.

COLMAP counts pixels from the corner of the first one, so its numbers are larger by half a pixel.
Its poses are `camera_from_world`, its identifiers count from 1 here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pilotage import Camera, Transform
from pilotage.errors import InputError
from pilotage.models.model import Model

HALF_PX = 0.5
UNSEEN = -1  # the point of a pixel that belongs to none
# Name: number in binary files, number of parameters.
CAMERA_MODELS = {
    "SIMPLE_PINHOLE": (0, 3),
    "PINHOLE": (1, 4),
    "SIMPLE_RADIAL": (2, 4),
    "RADIAL": (3, 5),
    "OPENCV": (4, 8),
    "OPENCV_FISHEYE": (5, 8),
    "FULL_OPENCV": (6, 12),
}
ONE_FOCAL = {"SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL"}


@dataclass(frozen=True)
class CameraRow:
    """One line of `cameras`."""

    identifier: int
    model: str
    width_px: int
    height_px: int
    parameters: tuple[float, ...]


@dataclass(frozen=True)
class ImageRow:
    """One entry of `images`; `pixels` (K, 2) count from the corner, `points` (K,) may be UNSEEN."""

    identifier: int
    quaternion_wxyz: tuple[float, ...]
    translation: tuple[float, ...]
    camera: int
    name: str
    pixels: NDArray[np.float64]
    points: NDArray[np.int64]


@dataclass(frozen=True)
class PointRow:
    """One entry of `points3D`; `track` (L, 2) holds pairs of image and place among its pixels."""

    identifier: int
    position: tuple[float, ...]
    color: tuple[int, ...]
    error_px: float
    track: NDArray[np.int64]


@dataclass(frozen=True)
class Tables:
    """A whole model as COLMAP has it."""

    cameras: Sequence[CameraRow]
    images: Sequence[ImageRow]
    points: Sequence[PointRow]


def tables_of(model: Model) -> Tables:
    """Return a model's tables. InputError where COLMAP has no lens like a camera's."""
    order = np.argsort(model.picture, kind="stable")
    ends = np.searchsorted(model.picture[order], np.arange(len(model.names) + 1))
    place = np.empty(len(order), np.int64)
    images = []
    for i, name in enumerate(model.names):
        rows = order[ends[i] : ends[i + 1]]
        place[rows] = np.arange(len(rows))
        pose = model.camera_from_world[i]
        images.append(
            ImageRow(
                identifier=i + 1,
                quaternion_wxyz=tuple(pose.quaternion_wxyz.tolist()),
                translation=tuple(pose.translation_m.tolist()),
                camera=int(model.camera_index[i]) + 1,
                name=name,
                pixels=model.pixel_px[rows] + HALF_PX,
                points=model.point[rows] + 1,
            )
        )
    cameras = [camera_row(i + 1, camera) for i, camera in enumerate(model.cameras)]
    return Tables(cameras, images, _point_rows(model, place))


def _point_rows(model: Model, place: NDArray[np.int64]) -> list[PointRow]:
    """Return a row for each point; `place` (M,) is that of an observation in its picture."""
    errors = model.reprojection_errors_px()
    order = np.argsort(model.point, kind="stable")
    ends = np.searchsorted(model.point[order], np.arange(len(model.points_in_world) + 1))
    tracks = np.column_stack([model.picture[order] + 1, place[order]])
    rows = []
    for i, (position, color) in enumerate(
        zip(model.points_in_world.tolist(), model.colors.tolist(), strict=True)
    ):
        seen = slice(ends[i], ends[i + 1])
        # COLMAP's own mark of an unknown error.
        known = errors[order[seen]]
        error_px = float(known.mean()) if len(known) and np.isfinite(known).all() else -1.0
        rows.append(PointRow(i + 1, tuple(position), tuple(color), error_px, tracks[seen]))
    return rows


def model_of(tables: Tables) -> Model:
    """Return the model; pixels that belong to no point are left out. InputError names what fails.

    Pictures and points keep the order of the tables.
    """
    cameras = {row.identifier: i for i, row in enumerate(tables.cameras)}
    points = {row.identifier: i for i, row in enumerate(tables.points)}
    picture, point, pixel = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros((0, 2))]
    for i, image in enumerate(tables.images):
        seen = image.points != UNSEEN
        picture.append(np.full(np.count_nonzero(seen), i, np.int64))
        point.append(_indices(image, image.points[seen], points))
        pixel.append(image.pixels[seen] - HALF_PX)
        if image.camera not in cameras:
            raise InputError(f"image {image.name} is of camera {image.camera}, which is missing")
    return Model(
        cameras=tuple(_camera(row) for row in tables.cameras),
        names=tuple(image.name for image in tables.images),
        camera_index=np.array([cameras[image.camera] for image in tables.images], np.int64),
        camera_from_world=tuple(
            Transform(translation_m=image.translation, quaternion_wxyz=image.quaternion_wxyz)
            for image in tables.images
        ),
        points_in_world=np.array([row.position for row in tables.points], float).reshape(-1, 3),
        colors=np.array([row.color for row in tables.points], np.uint8).reshape(-1, 3),
        picture=np.concatenate(picture),
        point=np.concatenate(point),
        pixel_px=np.concatenate(pixel),
    )


def _indices(
    image: ImageRow, identifiers: NDArray[np.int64], points: dict[int, int]
) -> NDArray[np.int64]:
    try:
        return np.array([points[identifier] for identifier in identifiers.tolist()], np.int64)
    except KeyError as missing:
        raise InputError(f"image {image.name} sees point {missing}, which is missing") from missing


def camera_row(identifier: int, camera: Camera) -> CameraRow:
    """Return a camera as COLMAP has it. InputError where it has no such lens."""
    lens = list(camera.coefficients)
    if camera.distortion == "none":
        model, coefficients = "PINHOLE", []
    elif camera.distortion == "brown" and not any(lens[4:]):
        model, coefficients = "OPENCV", lens[:4]
    elif camera.distortion == "brown":
        model, coefficients = "FULL_OPENCV", [*lens, 0.0, 0.0, 0.0]
    elif camera.distortion == "kannala_brandt":
        model, coefficients = "OPENCV_FISHEYE", lens
    else:
        raise InputError(f"COLMAP has no camera with a lens {camera.distortion}")
    centre = (camera.cx_px + HALF_PX, camera.cy_px + HALF_PX)
    parameters = (camera.fx_px, camera.fy_px, *centre, *coefficients)
    return CameraRow(identifier, model, camera.width_px, camera.height_px, parameters)


def _camera(row: CameraRow) -> Camera:
    focal = row.parameters[:1] * 2 if row.model in ONE_FOCAL else row.parameters[:2]
    rest = row.parameters[1:] if row.model in ONE_FOCAL else row.parameters[2:]
    lens = list(rest[2:])
    if row.model == "FULL_OPENCV":
        if any(lens[5:]):
            raise InputError(f"camera {row.identifier}: a rational lens (k4 to k6) is not known")
        lens = lens[:5]
    elif row.model in {"SIMPLE_RADIAL", "RADIAL"}:
        lens = [*lens, 0.0, 0.0, 0.0][:4]
    fisheye = row.model == "OPENCV_FISHEYE"
    return Camera(
        width_px=row.width_px,
        height_px=row.height_px,
        fx_px=focal[0],
        fy_px=focal[1],
        cx_px=rest[0] - HALF_PX,
        cy_px=rest[1] - HALF_PX,
        distortion="kannala_brandt" if fisheye else "brown" if lens else "none",
        coefficients=lens,
    )
