# SPDX-License-Identifier: Apache-2.0
"""A reconstruction as one value: cameras, poses of pictures, points, and which saw which where."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pilotage import Camera, Transform


@dataclass(frozen=True, kw_only=True, eq=False)
class Model:
    """P registered pictures, N points, M observations of points in pictures.

    Lengths are metres where the scale is known, else the model's own unit. Pixel (0, 0) is the
    centre of the first pixel. ValueError names what does not fit together.
    """

    cameras: tuple[Camera, ...]
    names: tuple[str, ...]
    """(P,) of the registered pictures, relative to their folder."""
    camera_index: NDArray[np.int64]
    """(P,) into `cameras`."""
    camera_from_world: tuple[Transform, ...]
    """(P,)"""
    points_in_world: NDArray[np.float64]
    """(N, 3)"""
    colors: NDArray[np.uint8]
    """(N, 3) red, green, blue."""
    picture: NDArray[np.int64]
    """(M,) into `names`, of each observation."""
    point: NDArray[np.int64]
    """(M,) into `points_in_world`, of each observation."""
    pixel_px: NDArray[np.float64]
    """(M, 2) where the point was seen."""

    def __post_init__(self) -> None:
        pictures, points, seen = len(self.names), len(self.points_in_world), len(self.pixel_px)
        shapes: dict[str, tuple[NDArray[Any], tuple[int, ...]]] = {
            "camera_index": (self.camera_index, (pictures,)),
            "points_in_world": (self.points_in_world, (points, 3)),
            "colors": (self.colors, (points, 3)),
            "picture": (self.picture, (seen,)),
            "point": (self.point, (seen,)),
            "pixel_px": (self.pixel_px, (seen, 2)),
        }
        for name, (array, shape) in shapes.items():
            if array.shape != shape:
                raise ValueError(f"{name} has the shape {array.shape}; must be {shape}")
        if len(self.camera_from_world) != pictures:
            raise ValueError(f"{len(self.camera_from_world)} poses of {pictures} pictures")
        if len(set(self.names)) != pictures:
            raise ValueError("two pictures have one name; names must differ")
        _check_range("camera_index", self.camera_index, len(self.cameras))
        _check_range("picture", self.picture, pictures)
        _check_range("point", self.point, points)

    def camera_of(self, picture: int) -> Camera:
        """Return the camera that took a picture, by the picture's index."""
        return self.cameras[int(self.camera_index[picture])]

    def world_from_camera(self) -> NDArray[np.float64]:
        """Return the poses of all pictures, (P, 4, 4)."""
        poses = [pose.inverse().matrix() for pose in self.camera_from_world]
        return np.array(poses).reshape(-1, 4, 4)

    def scaled(self, factor: float) -> Model:
        """Return the model with all lengths multiplied."""
        poses = tuple(
            Transform(
                translation_m=(factor * np.asarray(pose.translation_m)).tolist(),
                quaternion_wxyz=np.asarray(pose.quaternion_wxyz).tolist(),
            )
            for pose in self.camera_from_world
        )
        points = factor * self.points_in_world
        return Model(**{**vars(self), "camera_from_world": poses, "points_in_world": points})

    def reprojection_errors_px(self) -> NDArray[np.float64]:
        """Return (M,) distances between seen and projected; NaN behind a camera or its lens."""
        errors = np.full(len(self.pixel_px), np.nan)
        order = np.argsort(self.picture, kind="stable")
        ends = np.searchsorted(self.picture[order], np.arange(len(self.names) + 1))
        for i, pose in enumerate(self.camera_from_world):
            rows = order[ends[i] : ends[i + 1]]
            if len(rows) == 0:
                continue
            camera_from_world = pose.matrix()
            points = self.points_in_world[self.point[rows]]
            points_in_camera = points @ camera_from_world[:3, :3].T + camera_from_world[:3, 3]
            projected = self.camera_of(i).project(np.ascontiguousarray(points_in_camera))
            errors[rows] = np.linalg.norm(projected - self.pixel_px[rows], axis=1)
        return errors


def _check_range(name: str, indices: NDArray[np.int64], count: int) -> None:
    if len(indices) and not 0 <= indices.min() <= indices.max() < count:
        raise ValueError(
            f"{name} reaches from {indices.min()} to {indices.max()}; must lie in 0 to {count - 1}"
        )
