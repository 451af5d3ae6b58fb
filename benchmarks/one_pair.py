# SPDX-License-Identifier: Apache-2.0
"""Depth of one stereo pair against true disparities (Middlebury 2014, Scharstein et al.)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]

# Quarter resolution of the motorcycle, from the recording's note.
FOCAL_PX = 994.978
CX_PX, CY_PX = 311.193, 254.877
CX_SHIFT_PX = 31.086
BASELINE_M = 0.193001


def motorcycle_rig(width_px: int, height_px: int) -> Any:
    """Return the rectified rig, whose principal points differ in x."""
    import pilotage

    def camera(cx_px: float) -> Any:
        return pilotage.Camera(
            width_px=width_px,
            height_px=height_px,
            fx_px=FOCAL_PX,
            fy_px=FOCAL_PX,
            cx_px=cx_px,
            cy_px=CY_PX,
        )

    right_from_left = np.eye(4)
    right_from_left[0, 3] = -BASELINE_M
    return pilotage.StereoRig(
        left=camera(CX_PX),
        right=camera(CX_PX + CX_SHIFT_PX),
        right_from_left=pilotage.Transform.from_matrix(right_from_left),
    )


def disparity_errors_px(points_in_left: Array, true_px: Array) -> Array:
    """Return (K,) errors of disparity, px, of (N, 3) points that fall on a known one."""
    z = points_in_left[:, 2]
    points = points_in_left[z > 0.1]
    x = FOCAL_PX * points[:, 0] / points[:, 2] + CX_PX
    y = FOCAL_PX * points[:, 1] / points[:, 2] + CY_PX
    column, row = np.rint(x).astype(int), np.rint(y).astype(int)
    height, width = true_px.shape
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    disparity = FOCAL_PX * BASELINE_M / points[:, 2] - CX_SHIFT_PX
    errors = disparity[inside] - true_px[row[inside], column[inside]]
    return errors[np.isfinite(errors)]


def middlebury_figures(folder: Path) -> str:
    """Track the one pair and say how well its points lie."""
    import pilotage

    left, right = (
        cv2.imread(str(folder / f"motorcycle_{side}.png"), cv2.IMREAD_GRAYSCALE)
        for side in ("left", "right")
    )
    with np.load(folder / "motorcycle_disp.npz") as saved:
        true_px = saved["arr_0"]
    height_px, width_px = left.shape
    odometry = pilotage.StereoOdometry(
        rig=motorcycle_rig(width_px, height_px), config=pilotage.OdometryConfig()
    )
    odometry.track(left, right, 0)
    odometry.finish()
    errors = disparity_errors_px(np.asarray(odometry.points(), float).reshape(-1, 3), true_px)
    if not len(errors):
        return "one pair, no trajectory; its points could not be checked for depth"
    return (
        f"one pair, no trajectory; {len(errors)} points on known disparities, error"
        f" {np.median(np.abs(errors)):.3f} px in the median,"
        f" {np.mean(np.abs(errors) > 1):.1%} above 1 px"
    )
