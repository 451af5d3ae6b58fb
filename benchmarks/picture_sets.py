# SPDX-License-Identifier: Apache-2.0
"""The picture sets that reconstructions are measured on: pictures, their camera, the truth.

Real ones lie in $PILOTAGE_DATA; each has a function that reads its own truth. The office walk is
rendered, see `office_walk.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import office_walk
import yaml
from decoded import DATA_FOLDER

from pilotage import Camera
from pilotage.errors import InputError
from pilotage.evaluation.poses import interpolate
from pilotage.evaluation.truth import WIDEST_GAP_NS, load_truth
from pilotage.models import read_colmap_text

Array = npt.NDArray[Any]
# Of a picture halved in size, where pixel (0, 0) is the centre of the first one.
HALVED = np.array([[0.5, 0, -0.25], [0, 0.5, -0.25], [0, 0, 1]])
# Above so many pictures not every pair of them is matched, if their order means something.
MANY = 60


@dataclass(frozen=True)
class PictureSet:
    """N pictures of one camera; truth is `world_from_camera` (N, 4, 4), NaN where unknown.

    Without `is_metric` the truth's unit of length is its own. `is_ordered`: neighbours in the list
    were taken one after the other.
    """

    name: str
    pictures: tuple[Path, ...]
    camera: Camera
    truth: Array
    is_metric: bool = True
    is_ordered: bool = True

    def every(self, step: int) -> PictureSet:
        """Return the set with each `step`-th picture only."""
        if step == 1:
            return self
        name, chosen = f"{self.name} /{step}", slice(None, None, step)
        return replace(self, name=name, pictures=self.pictures[chosen], truth=self.truth[chosen])


def strecha(folder: Path, _: Path) -> PictureSet:
    """Return one of the multi-view benchmark by Strecha et al.; truth from a laser scan."""
    pictures = sorted((folder / "images").glob("*.jpg"))
    rows = [
        np.array((folder / "truth_cameras" / f"{picture.name}.camera").read_text().split(), float)
        for picture in pictures
    ]
    matrix = HALVED @ rows[0][:9].reshape(3, 3)
    truth = np.tile(np.eye(4), (len(rows), 1, 1))
    for pose, row in zip(truth, rows, strict=True):
        pose[:3, :3], pose[:3, 3] = row[12:21].reshape(3, 3), row[21:24]
    width_px, height_px = (int(value) // 2 for value in rows[0][24:26])
    camera = pinhole(width_px, height_px, matrix)
    return PictureSet(folder.name, tuple(pictures), camera, truth, is_ordered=False)


def lund(folder: Path, _: Path) -> PictureSet:
    """Return a set with a COLMAP model of the pictures in full size; its scale is not known."""
    model = read_colmap_text(folder / "colmap_reference")
    pictures = tuple(sorted((folder / "images").glob("*.JPG")))
    order = [model.names.index(picture.name) for picture in pictures]
    truth = model.world_from_camera()[order]
    full = model.cameras[0]
    camera = pinhole(
        full.width_px // 2,
        full.height_px // 2,
        HALVED @ [[full.fx_px, 0, full.cx_px], [0, full.fy_px, full.cy_px], [0, 0, 1]],
        distortion=full.distortion,
        coefficients=full.coefficients,
    )
    return PictureSet(folder.name, pictures, camera, truth, is_metric=False, is_ordered=False)


def euroc(folder: Path, _: Path) -> PictureSet:
    """Return the left pictures of a flight, not rectified; truth from motion capture."""
    # The files begin with a line that is no YAML.
    sensor = yaml.safe_load((folder / "cam0_sensor.yaml").read_text().partition("\n")[2])
    pictures = sorted((folder / "images").glob("*_0.jpg"))
    body = load_truth(folder / "truth_body_tum.txt")
    if body.timestamps_ns is None:
        raise InputError(f"{folder}: its truth has no times")
    times_ns = np.array([int(picture.stem.split("_")[0]) for picture in pictures])
    world_from_body = interpolate(
        times_ns=body.timestamps_ns, poses=body.poses, at_ns=times_ns, widest_gap_ns=WIDEST_GAP_NS
    )
    fx, fy, cx, cy = sensor["intrinsics"]
    camera = pinhole(
        *sensor["resolution"],
        np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]),
        distortion="brown",
        # YAML takes 1e-05, which has no dot, for a word.
        coefficients=[float(value) for value in sensor["distortion_coefficients"]],
    )
    body_from_camera = np.array(sensor["T_BS"]["data"]).reshape(4, 4)
    return PictureSet(folder.name, tuple(pictures), camera, world_from_body @ body_from_camera)


def kitti(folder: Path, _: Path) -> PictureSet:
    """Return the left pictures of a drive, rectified; truth from satellites and inertia."""
    pictures = tuple(sorted((folder / "image_0").glob("*.jpg")))
    row = next(line for line in (folder / "calib.txt").read_text().splitlines() if "P0:" in line)
    matrix = np.array(row.split()[1:], float).reshape(3, 4)[:, :3]
    height_px, width_px = picture_size(pictures[0])
    camera = pinhole(width_px, height_px, matrix)
    truth = load_truth(folder / "poses.txt").poses[: len(pictures)]
    return PictureSet(folder.name, pictures, camera, truth)


def office(_: Path, cache: Path) -> PictureSet:
    """Return the rendered walk; the truth is exact."""
    pictures, camera, truth = office_walk.made_once(cache)
    return PictureSet(office_walk.NAME, pictures, camera, truth)


READERS: dict[str, Callable[[Path, Path], PictureSet]] = {
    "strecha_fountain": strecha,
    "strecha_herzjesu": strecha,
    "lund_door": lund,
    "kitti_a": kitti,
    "kitti_b": kitti,
    "kitti_c": kitti,
    "euroc_keyframes": euroc,
    office_walk.NAME: office,
}


def load_set(name: str, cache: Path) -> PictureSet:
    """Return a set by its name, one of `READERS`. InputError where its folder is missing."""
    folder = DATA_FOLDER / name
    if name != office_walk.NAME and not folder.is_dir():
        raise InputError(f"{folder} is missing; set PILOTAGE_DATA to the folder of recordings")
    return READERS[name](folder, cache)


def pinhole(width_px: int, height_px: int, matrix: Array, **lens: Any) -> Camera:
    """Return the camera of a (3, 3) matrix, with a lens when one is given."""
    return Camera(
        width_px=width_px,
        height_px=height_px,
        fx_px=float(matrix[0, 0]),
        fy_px=float(matrix[1, 1]),
        cx_px=float(matrix[0, 2]),
        cy_px=float(matrix[1, 2]),
        **lens,
    )


def picture_size(path: Path) -> tuple[int, int]:
    """Return height and width."""
    import cv2

    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise InputError(f"{path}: not a picture")
    height_px, width_px = picture.shape
    return height_px, width_px
