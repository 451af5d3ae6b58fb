# SPDX-License-Identifier: Apache-2.0
"""`load_camera`: the calibration of a single camera, or of the left one of a pair."""

from __future__ import annotations

import math
from pathlib import Path

from pilotage import Camera
from pilotage.calibration import euroc, own, ros
from pilotage.calibration.document import Section, read_documents
from pilotage.calibration.files import find_calibration, load_rig
from pilotage.errors import InputError

WIDEST_FIELD_OF_VIEW_DEG = 150.0


def load_camera(path: Path, *, image_size_px: tuple[int, int] | None = None) -> Camera:
    """Return the camera of a file (or of the one in a folder): of one camera, or a pair's left one.

    One camera is written as in ROS (camera_info), EuRoC (sensor.yaml) or our own style (width_px,
    fx_px and so on); pairs in whatever `load_rig` reads. InputError names file, key and remedy.
    """
    file = find_calibration(path) if path.is_dir() else path
    if file is None:
        raise InputError(f"{path}: holds no calibration; name one with --calibration")
    if file.suffix.lower() != ".txt" and file.is_file():
        camera = _single(read_documents(file)[0])
        if camera is not None:
            return camera
    return load_rig(file, image_size_px=image_size_px).left


def _single(section: Section) -> Camera | None:
    if "fx_px" in section:
        return own.read_camera(section)
    if euroc.is_euroc(section):
        return euroc.read_camera(section)
    if ros.is_ros(section):
        return ros.read_side(section).camera
    return None


def camera_of_view(size_px: tuple[int, int], horizontal_deg: float) -> Camera:
    """Return the pinhole of that horizontal field of view, square pixels, centred; no lens."""
    if not 1 <= horizontal_deg <= WIDEST_FIELD_OF_VIEW_DEG:
        raise InputError(
            f"field of view {horizontal_deg:g} degrees: must be from 1 to "
            f"{WIDEST_FIELD_OF_VIEW_DEG:g}; wider lenses need a calibration"
        )
    width, height = size_px
    focal_px = 0.5 * width / math.tan(0.5 * math.radians(horizontal_deg))
    return Camera(
        width_px=width, height_px=height, fx_px=focal_px, fy_px=focal_px,
        cx_px=0.5 * (width - 1), cy_px=0.5 * (height - 1),
    )  # fmt: skip
