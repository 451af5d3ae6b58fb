# SPDX-License-Identifier: Apache-2.0
"""`load_rig` and `save_rig`: a stereo calibration out of whichever style a file is written in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pilotage import StereoRig
from pilotage.calibration.document import Section, read_documents
from pilotage.calibration.euroc import body_from_camera, is_euroc, read_euroc
from pilotage.calibration.kalibr import is_kalibr, read_kalibr
from pilotage.calibration.kitti import read_kitti
from pilotage.calibration.opencv_storage import is_opencv, read_opencv
from pilotage.calibration.own import is_own, read_own, write_own
from pilotage.calibration.rig_calibration import has_pairs, read_pair
from pilotage.calibration.ros import is_ros, read_ros
from pilotage.errors import InputError

# Looked for in a folder, in this order; a pattern may match one file only.
CALIBRATION_NAMES = (
    "rig.yaml", "calibration.yaml", "calib.yaml", "stereo.yaml", "*camchain*.yaml", "left.yaml",
    "cam0_sensor.yaml", "cam0/sensor.yaml", "mav0/cam0/sensor.yaml", "cam0.yaml", "calib.txt",
    "*.yaml", "*.yml",
)  # fmt: skip
# How the files of the left and the right camera differ in name.
SIDE_NAMES = (("left", "right"), ("Left", "Right"), ("LEFT", "RIGHT"), ("cam0", "cam1"),
              ("_0", "_1"), ("_l", "_r"), ("_L", "_R"), ("-l", "-r"), ("-L", "-R"))  # fmt: skip
STYLES = (
    "Pilotage (right_from_left, or pairs of them), Kalibr camchain (cam0, cam1), "
    "ROS camera_info (camera_matrix), EuRoC sensor.yaml (T_BS), "
    "OpenCV FileStorage (cameraMatrix1), KITTI calib.txt (P0)"
)


def load_rig(
    path: str | Path,
    *,
    image_size_px: tuple[int, int] | None = None,
    colour: bool = False,
    pair: str | None = None,
) -> StereoRig:
    """Return the stereo rig of a calibration file, or of a folder that holds one.

    `image_size_px` (width, height) fills in for styles that do not say it; `colour` chooses
    KITTI's P2 and P3; `pair` is that of a file of several pairs, by default its first.
    Raises InputError that names file, key, value and remedy.
    """
    try:
        return _load(Path(path), image_size_px, colour, pair)
    except (OSError, ValueError) as error:  # no permission, a name too long or with a zero byte
        raise InputError(f"{str(path)!r}: cannot be read ({error}); check the path") from error


def _load(  # noqa: PLR0911, one for each style
    file: Path, image_size_px: tuple[int, int] | None, colour: bool, pair: str | None
) -> StereoRig:
    if file.is_dir():
        found = find_calibration(file)
        if found is None:
            raise InputError(
                f"{file}: holds no calibration; add one named {', '.join(CALIBRATION_NAMES)}"
            )
        file = found
    if file.suffix.lower() == ".txt":
        return read_kitti(file, image_size_px, colour=colour)
    documents = read_documents(file)
    first = documents[0]
    if has_pairs(first):
        return read_pair(first, pair)
    if is_own(first):
        return read_own(first)
    if is_kalibr(first):
        return read_kalibr(first)
    if is_opencv(first):
        return read_opencv(first, image_size_px)
    left, right = _two_cameras(documents)
    if is_euroc(left):
        return read_euroc(left, right)
    if is_ros(left):
        return read_ros(left, right)
    raise InputError(f"{file}: fits no known style; must be one of: {STYLES}")


def save_rig(rig: StereoRig, path: str | Path) -> None:
    """Write a rig in our own style; `load_rig` gives it back exactly."""
    Path(path).write_text(write_own(rig), encoding="utf-8")


def find_calibration(folder: Path) -> Path | None:
    """Return the folder's calibration file, the left one of a pair; None when there is none."""
    for pattern in CALIBRATION_NAMES:
        found = sorted(file for file in folder.glob(pattern) if file.is_file())
        if len(found) == 1:
            return found[0]
        lefts = [file for file in found if _partner(file, 0) is not None]
        if len(lefts) == 1:
            return lefts[0]
    return None


def load_body_from_left(path: Path) -> NDArray[np.float64] | None:
    """Return (4, 4) body_from_left of an EuRoC calibration; None for styles without a body."""
    file = find_calibration(path) if path.is_dir() else path
    if file is None or file.suffix.lower() == ".txt":
        return None
    left = _two_cameras(read_documents(file))[0]
    return body_from_camera(left) if is_euroc(left) else None


def _two_cameras(documents: list[Section]) -> tuple[Section, Section]:
    """Left and right section: two documents, two keys, or the partner file."""
    first = documents[0]
    if len(documents) == 2:
        return documents[0], documents[1]
    if "left" in first and "right" in first:
        first.refuse_unknown(["left", "right"])
        return first.section("left"), first.section("right")
    if not (is_euroc(first) or is_ros(first)):
        return first, first
    for side in (0, 1):
        partner = _partner(first.file, side)
        if partner is not None:
            other = read_documents(partner)[0]
            return (first, other) if side == 0 else (other, first)
    raise InputError(
        f"{first.file}: describes one camera and the file of the other is not beside it; "
        "name them left.yaml and right.yaml, or cam0 and cam1"
    )


def _partner(file: Path, side: int) -> Path | None:
    """Return the other camera's file when `file` is named after the left (0) or right (1) one."""
    for names in SIDE_NAMES:
        mine, other = names[side], names[1 - side]
        head, found, tail = file.name.rpartition(mine)
        candidates = [file.with_name(head + other + tail)] if found else []
        if mine in file.parent.name:
            folder = file.parent.with_name(file.parent.name.replace(mine, other))
            candidates.append(folder / file.name)
        for candidate in candidates:
            if candidate.is_file():
                return candidate
    return None
