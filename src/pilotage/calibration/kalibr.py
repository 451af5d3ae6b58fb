# SPDX-License-Identifier: Apache-2.0
"""Kalibr camchain: cam0 is the left camera, cam1 the right one, `T_cn_cnm1` = cam1_from_cam0."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pilotage import Camera, StereoRig, Transform
from pilotage.calibration.document import Section
from pilotage.calibration.rig import check_size, check_transform, make_camera, make_rig, read_lens

CAMERA_KEYS = (
    "cam_overlaps", "camera_model", "distortion_coeffs", "distortion_model", "intrinsics",
    "resolution", "rostopic", "T_cam_imu", "timeshift_cam_imu", "T_cn_cnm1", "line_delay",
)  # fmt: skip
MODELS_REFUSED = "only pinhole can be used; calibrate with pinhole-radtan or pinhole-equi"


def is_kalibr(section: Section) -> bool:
    """Tell a camchain by its first camera."""
    return "cam0" in section


def read_kalibr(section: Section) -> StereoRig:
    """Return the rig of a camchain's first two cameras."""
    section.refuse_unknown([f"cam{i}" for i in range(8)])
    left, right = section.section("cam0"), section.section("cam1")
    right_from_left = _right_from_left(left, right)
    return make_rig(
        section.file,
        _read_camera(left),
        _read_camera(right),
        Transform.from_matrix(right_from_left),
    )


def _right_from_left(left: Section, right: Section) -> NDArray[np.float64]:
    if "T_cn_cnm1" in right or "T_cam_imu" not in right:
        return _rigid(right, "T_cn_cnm1")
    product: NDArray[np.float64] = _rigid(right, "T_cam_imu") @ np.linalg.inv(
        _rigid(left, "T_cam_imu")
    )
    return product


def _rigid(section: Section, key: str) -> NDArray[np.float64]:
    return check_transform(section.file, f"{section.where}.{key}", section.matrix(key, 4, 4))


def _read_camera(section: Section) -> Camera:
    section.refuse_unknown(CAMERA_KEYS)
    if section.text("camera_model") != "pinhole":
        raise section.fault("camera_model", MODELS_REFUSED)
    lens = read_lens(section, "distortion_model", "distortion_coeffs")
    size_px = check_size(section, *section.numbers("resolution", [2]))
    return make_camera(section, size_px, section.numbers("intrinsics", [4]), lens)
