# SPDX-License-Identifier: Apache-2.0
"""A stereo pair as ROS says it: transforms that lose no digit, and the rectified cameras."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pilotage import Rectifier, StereoRig, Transform
from pilotage.errors import InputError

AXES_SUFFIX = "_axes"
IDENTITY_WXYZ = [1.0, 0.0, 0.0, 0.0]


def stereo_transforms(
    right_from_left: Transform, left: str, right: str
) -> dict[tuple[str, str], Transform]:
    """Return right's place on left, by (parent, child), from which `right_from_left` comes exactly.

    A rotation alone and a translation alone lose no digit when inverted, both together do. So a
    turned right camera hangs on a frame between: at the left camera, with the right one's axes.
    """
    axes_from_right = Transform(translation_m=(-right_from_left.translation_m).tolist())
    if right_from_left.quaternion_wxyz.tolist() == IDENTITY_WXYZ:
        return {(left, right): axes_from_right}
    rotation = Transform(quaternion_wxyz=right_from_left.quaternion_wxyz.tolist())
    axes = right + AXES_SUFFIX
    return {(left, axes): rotation.inverse(), (axes, right): axes_from_right}


def rectification(rig: StereoRig) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return rotation (3, 3) and projection (3, 4) of the ideal left and right camera, pixels."""
    try:
        rectifier = Rectifier(rig=rig)
    except ValueError as error:
        raise InputError(f"the rig cannot be rectified ({error}); calibrate again") from None
    ideal, result = rectifier.stereo, []
    sides = (
        (rectifier.rectified_from_left, ideal.cx_px, 0.0),
        (rectifier.rectified_from_right, ideal.cx_right_px, ideal.baseline_m),
    )
    for turn, cx_px, shift_m in sides:
        f = ideal.focal_px
        projection = [[f, 0, cx_px, -f * shift_m], [0, f, ideal.cy_px, 0], [0, 0, 1, 0]]
        result.append((np.array(turn.matrix()[:3, :3]), np.array(projection)))
    return result
