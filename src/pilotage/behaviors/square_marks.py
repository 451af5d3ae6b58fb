# SPDX-License-Identifier: Apache-2.0
"""Printed square marks (AprilTag, ArUco) in pictures: a known side tells how long a metre is."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pilotage.errors import InputError

if TYPE_CHECKING:
    from pilotage import Camera, MarkAccount, MarkSighting
    from pilotage.recordings.frames import Grey

FAMILIES: Mapping[str, int] = {
    "apriltag-36h11": cv2.aruco.DICT_APRILTAG_36h11,
    "apriltag-25h9": cv2.aruco.DICT_APRILTAG_25h9,
    "apriltag-16h5": cv2.aruco.DICT_APRILTAG_16h5,
    "aruco-4x4": cv2.aruco.DICT_4X4_50,
    "aruco-5x5": cv2.aruco.DICT_5X5_50,
    "aruco-6x6": cv2.aruco.DICT_6X6_50,
    "aruco-original": cv2.aruco.DICT_ARUCO_ORIGINAL,
}
# Of a corner's coordinates, after refinement along its edges.
CORNER_SIGMA_PX = 0.3
# A ruler is read so well.
SIDE_SIGMA_M = 0.0005
# So small, the black square is hardly more than its corners.
SMALLEST_SIDE_PX = 12.0


@dataclass(frozen=True, kw_only=True)
class MarkSize:
    """Side of a mark's black square, metres, and its family, one of `FAMILIES`."""

    side_m: float
    family: str = "apriltag-36h11"

    def __post_init__(self) -> None:
        if not (math.isfinite(self.side_m) and self.side_m > 2 * SIDE_SIGMA_M):
            raise InputError(
                f"--mark-size-m {self.side_m:g}: must be the side of the black square in metres,"
                f" above {2 * SIDE_SIGMA_M:g}"
            )
        if self.family not in FAMILIES:
            raise InputError(f"--mark-family {self.family}: must be one of {', '.join(FAMILIES)}")


def no_mark(marks: MarkSize) -> str:
    """Return why marks of a known size say nothing of a model's lengths."""
    return (
        f"no mark of the family {marks.family} is seen whole and sharp in two placed pictures from"
        " places well apart"
    )


def find_marks(
    pictures: Sequence[Grey],
    cameras: Sequence[Camera],
    camera_of_picture: Sequence[int],
    size: MarkSize,
) -> MarkAccount:
    """Return the marks that pictures, (height, width) uint8, show."""
    from pilotage import MarkAccount

    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    dictionary = cv2.aruco.getPredefinedDictionary(FAMILIES[size.family])
    detector = cv2.aruco.ArucoDetector(dictionary, parameters)
    sightings: list[MarkSighting] = []
    for number, picture in enumerate(pictures):
        camera = cameras[camera_of_picture[number]]
        corners, ids, _ = detector.detectMarkers(picture)
        if ids is None:
            continue
        for square, mark in zip(corners, np.ravel(ids), strict=True):
            sightings += _sighting(number, int(mark), square.reshape(4, 2), camera)
    return MarkAccount(sightings=sightings, side_m=size.side_m, side_sigma_m=SIDE_SIGMA_M)


def _sighting(
    picture: int,
    mark: int,
    corners_px: NDArray[Any],
    camera: Camera,
) -> list[MarkSighting]:
    """Return the sighting of a mark; none where it is too small or beyond what the lens shows."""
    from pilotage import MarkSighting

    sides_px = np.linalg.norm(corners_px - np.roll(corners_px, 1, axis=0), axis=1)
    rays = np.asarray(camera.unproject(np.ascontiguousarray(corners_px, np.float64)))
    if sides_px.min() < SMALLEST_SIDE_PX or not np.isfinite(rays).all():
        return []
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    sigma_rad = CORNER_SIGMA_PX / camera.fx_px
    return [MarkSighting(picture=picture, mark=mark, rays=list(rays), sigma_rad=sigma_rad)]
