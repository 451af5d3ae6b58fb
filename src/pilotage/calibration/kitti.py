# SPDX-License-Identifier: Apache-2.0
"""KITTI odometry calib.txt: 3x4 projections of rectified cameras, P0 P1 grey, P2 P3 colour."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pilotage import Camera, StereoRig, Transform
from pilotage.calibration.document import Section, read_text
from pilotage.calibration.rig import Lens, make_camera, make_rig
from pilotage.errors import InputError

KNOWN_KEY = re.compile(r"P[0-3]|Tr\w*|R\w*")


def read_kitti(file: Path, image_size_px: tuple[int, int] | None, *, colour: bool) -> StereoRig:
    """Return the rig of P0 and P1, or of P2 and P3 when `colour`; sizes come from the pictures."""
    if image_size_px is None:
        raise InputError(
            f"{file}: does not say how large the pictures are; "
            "keep it beside image_0 and image_1, or use a YAML calibration"
        )
    section = Section(file, "", _read_lines(file))
    names = ("P2", "P3") if colour else ("P0", "P1")
    left, left_shift_m = _read_camera(section, names[0], image_size_px)
    right, right_shift_m = _read_camera(section, names[1], image_size_px)
    right_from_left = np.eye(4)
    right_from_left[:3, 3] = right_shift_m - left_shift_m
    return make_rig(file, left, right, Transform.from_matrix(right_from_left))


def _read_lines(file: Path) -> dict[str, list[str]]:
    values: dict[str, list[str]] = {}
    for number, line in enumerate(read_text(file).splitlines(), start=1):
        if not line.strip():
            continue
        key, colon, rest = line.partition(":")
        if not colon or not KNOWN_KEY.fullmatch(key.strip()) or key.strip() in values:
            raise InputError(
                f"{file}:{number}: {line[:60]!r}: must read 'P0: ' and 12 numbers, each key once"
            )
        values[key.strip()] = rest.split()
    return values


def _read_camera(
    section: Section, key: str, size_px: tuple[int, int]
) -> tuple[Camera, NDArray[np.float64]]:
    """Return the camera and its shift: point in this camera minus point in camera 0, metres."""
    p = section.matrix(key, 3, 4)
    intrinsics_px = [p[0, 0], p[1, 1], p[0, 2], p[1, 2]]
    camera = make_camera(Section(section.file, key, {}), size_px, intrinsics_px, Lens("none", ()))
    if np.abs(p[2, :3] - [0, 0, 1]).max() > 1e-9 or abs(p[0, 1]) > 1e-9 or abs(p[1, 0]) > 1e-9:
        raise section.fault(key, "must read fx 0 cx a  0 fy cy b  0 0 1 c; correct it")
    return camera, np.asarray(np.linalg.solve(p[:, :3], p[:, 3]), np.float64)
