# SPDX-License-Identifier: Apache-2.0
"""What `cv2.stereoCalibrate` users write with cv2.FileStorage: K, D of both, R and T in metres."""

from __future__ import annotations

import numpy as np

from pilotage import Camera, StereoRig, Transform
from pilotage.calibration.document import Section
from pilotage.calibration.rig import brown_lens, check_size, check_transform, make_camera, make_rig

# Left and right of each row belong together.
K_KEYS = (("cameraMatrix1", "cameraMatrix2"), ("M1", "M2"), ("K1", "K2"),
          ("cameraMatrixL", "cameraMatrixR"), ("camera_matrix_1", "camera_matrix_2"))  # fmt: skip
D_KEYS = (("distCoeffs1", "distCoeffs2"), ("D1", "D2"), ("distCoeffsL", "distCoeffsR"),
          ("dist_coeffs_1", "dist_coeffs_2"))  # fmt: skip
SIZE_KEYS = ("imageSize", "image_size", "size")
WIDTH_KEYS, HEIGHT_KEYS = ("image_width", "width"), ("image_height", "height")
# Results of the calibration that follow from the others.
OTHER_KEYS = ("R", "T", "E", "F", "R1", "R2", "P1", "P2", "Q", "rms", "calibration_time",
              "nframes", "nr_of_frames", "board_width", "board_height", "square_size")  # fmt: skip


def is_opencv(section: Section) -> bool:
    """Tell FileStorage files by a left camera matrix."""
    return any(left in section for left, _ in K_KEYS)


def read_opencv(section: Section, image_size_px: tuple[int, int] | None) -> StereoRig:
    """Return the rig of one file; the pictures' size fills in when the file does not say it."""
    pairs = [key for row in (*K_KEYS, *D_KEYS) for key in row]
    section.refuse_unknown([*pairs, *SIZE_KEYS, *WIDTH_KEYS, *HEIGHT_KEYS, *OTHER_KEYS])
    size_px = _read_size(section, image_size_px)
    right_from_left = np.eye(4)
    right_from_left[:3, :3] = section.matrix("R", 3, 3)
    right_from_left[:3, 3] = section.numbers("T", [3])
    check_transform(section.file, "R", right_from_left)
    return make_rig(
        section.file,
        _read_camera(section, 0, size_px),
        _read_camera(section, 1, size_px),
        Transform.from_matrix(right_from_left),
    )


def _read_camera(section: Section, side: int, size_px: tuple[int, int]) -> Camera:
    k = section.matrix(section.first_of(*(row[side] for row in K_KEYS)), 3, 3)
    d_key = section.first_of(*(row[side] for row in D_KEYS))
    lens = brown_lens(section, d_key, section.numbers(d_key, [0, 4, 5, 8, 12, 14]))
    return make_camera(section, size_px, [k[0, 0], k[1, 1], k[0, 2], k[1, 2]], lens)


def _read_size(section: Section, image_size_px: tuple[int, int] | None) -> tuple[int, int]:
    for key in SIZE_KEYS:
        if key in section:
            return check_size(section, *section.numbers(key, [2]))
    if any(key in section for key in WIDTH_KEYS):
        width, height = section.first_of(*WIDTH_KEYS), section.first_of(*HEIGHT_KEYS)
        return check_size(section, section.number(width), section.number(height))
    if image_size_px is None:
        raise section.fault("imageSize", "missing; add imageSize: [width, height]")
    return image_size_px
