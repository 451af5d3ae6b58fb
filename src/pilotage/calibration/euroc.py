# SPDX-License-Identifier: Apache-2.0
"""EuRoC (ASL) sensor.yaml, one a camera; `T_BS` = body_from_camera.

To its keys we add `readout_s`, for rolling shutters.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pilotage import Camera, StereoRig, Transform
from pilotage.calibration.document import Section
from pilotage.calibration.rig import (
    READOUT,
    check_size,
    check_transform,
    make_camera,
    make_rig,
    read_lens,
)

KNOWN_KEYS = (
    "sensor_type", "comment", "T_BS", "rate_hz", "resolution", "camera_model", "intrinsics",
    "distortion_model", "distortion_coefficients", READOUT,
)  # fmt: skip


def is_euroc(section: Section) -> bool:
    """Tell a sensor.yaml by its pose on the body."""
    return "T_BS" in section


def read_euroc(left: Section, right: Section) -> StereoRig:
    """Return the rig of two sensor.yaml files."""
    right_from_left = np.linalg.inv(body_from_camera(right)) @ body_from_camera(left)
    return make_rig(
        right.file,
        read_camera(left),
        read_camera(right),
        Transform.from_matrix(right_from_left),
        readout_s=left.number(READOUT) if READOUT in left else 0.0,
    )


def body_from_camera(section: Section) -> NDArray[np.float64]:
    """Return the camera's pose on the body, (4, 4), metres."""
    return check_transform(section.file, "T_BS", section.matrix("T_BS", 4, 4))


def read_camera(section: Section) -> Camera:
    """Return the camera of one sensor.yaml."""
    section.refuse_unknown(KNOWN_KEYS)
    if section.text("camera_model") != "pinhole":
        raise section.fault("camera_model", "only pinhole can be used; calibrate again")
    lens = read_lens(section, "distortion_model", "distortion_coefficients")
    size_px = check_size(section, *section.numbers("resolution", [2]))
    return make_camera(section, size_px, section.numbers("intrinsics", [4]), lens)
