# SPDX-License-Identifier: Apache-2.0
"""ROS camera_info: two files, two YAML documents, or one file with `left:` and `right:`.

K and D describe the raw pictures. R turns the raw camera into the rectified one, and the right
camera's P holds the base: P[0, 3] = -fx * baseline. The pose between the raw cameras follows.
Source: the definition of sensor_msgs/CameraInfo.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pilotage import Camera, StereoRig, Transform
from pilotage.calibration.document import Section
from pilotage.calibration.rig import check_size, check_transform, make_camera, make_rig, read_lens

# Key in a camera_info file, and in a message printed as YAML (ROS 1, ROS 2).
K_KEYS = ("camera_matrix", "K", "k")
D_KEYS = ("distortion_coefficients", "D", "d")
R_KEYS = ("rectification_matrix", "R", "r")
P_KEYS = ("projection_matrix", "P", "p")
WIDTH_KEYS, HEIGHT_KEYS = ("image_width", "width"), ("image_height", "height")
OTHER_KEYS = ("camera_name", "distortion_model", "header", "binning_x", "binning_y", "roi")
KNOWN_KEYS = (*K_KEYS, *D_KEYS, *R_KEYS, *P_KEYS, *WIDTH_KEYS, *HEIGHT_KEYS, *OTHER_KEYS)


@dataclass(frozen=True)
class Side:
    """A camera and where its rectified picture lies."""

    camera: Camera
    rectified_from_camera: NDArray[np.float64]  # (3, 3)
    shift_m: NDArray[np.float64]  # (3,): rectified point of this camera minus the rectified frame's


def is_ros(section: Section) -> bool:
    """Tell camera_info by its projection or camera matrix."""
    return any(key in section for key in (*K_KEYS, *P_KEYS))


def read_ros(left: Section, right: Section) -> StereoRig:
    """Return the rig of the two cameras' sections."""
    a, b = read_side(left), read_side(right)
    right_from_left = np.eye(4)
    right_from_left[:3, :3] = b.rectified_from_camera.T @ a.rectified_from_camera
    right_from_left[:3, 3] = b.rectified_from_camera.T @ (b.shift_m - a.shift_m)
    return make_rig(right.file, a.camera, b.camera, Transform.from_matrix(right_from_left))


def read_side(section: Section) -> Side:
    """Return what the section says of one camera of a pair."""
    section.refuse_unknown(KNOWN_KEYS)
    refuse_cropping(section)
    width, height = section.first_of(*WIDTH_KEYS), section.first_of(*HEIGHT_KEYS)
    size_px = check_size(section, section.number(width), section.number(height))
    k = section.matrix(section.first_of(*K_KEYS), 3, 3)
    lens = read_lens(section, "distortion_model", section.first_of(*D_KEYS))
    p_key = section.first_of(*P_KEYS)
    p = section.matrix(p_key, 3, 4)
    if not (p[0, 0] > 0 and p[1, 1] > 0):
        raise section.fault(p_key, "its focal lengths must be positive; calibrate the pair again")
    rectification = np.eye(4)
    rectification[:3, :3] = section.matrix(section.first_of(*R_KEYS), 3, 3)
    check_transform(section.file, R_KEYS[0], rectification)
    return Side(
        make_camera(section, size_px, [k[0, 0], k[1, 1], k[0, 2], k[1, 2]], lens),
        rectification[:3, :3],
        np.array([p[0, 3] / p[0, 0], p[1, 3] / p[1, 1], 0.0]),
    )


def refuse_cropping(section: Section) -> None:
    """Raise InputError where the pictures are not the whole ones that K describes."""
    for key in ("binning_x", "binning_y"):
        if key in section and section.number(key) not in (0, 1):
            raise section.fault(key, "binned pictures need a calibration at their own size")
    roi = section.section("roi") if "roi" in section else None
    for key in ("x_offset", "y_offset"):
        if roi is not None and key in roi and roi.number(key) != 0:
            raise roi.fault(key, "cropped pictures need a calibration of their own")
