# SPDX-License-Identifier: Apache-2.0
"""Cameras in MJCF, and our frames of them: x right, y down, z forward."""

from __future__ import annotations

from math import cos, sin

from pilotage import Transform

# MuJoCo's cameras look along -z with y up: half a turn about x.
MUJOCO_FROM_CAMERA = Transform(quaternion_wxyz=[0.0, 1.0, 0.0, 0.0])


def camera_element(
    name: str, position_m: tuple[float, float, float], pitch_rad: float, fovy_rad: float
) -> str:
    """Return a `<camera>` in a body whose x is forward and z up; positive pitch looks down.

    Looking straight down, the top of the picture is forward.
    """
    axes = f"0 -1 0 {_short(sin(pitch_rad))} 0 {_short(cos(pitch_rad))}"
    position = " ".join(_short(value) for value in position_m)
    return f'<camera name="{name}" pos="{position}" xyaxes="{axes}" fovy="{_short(fovy_rad)}"/>'


def _short(value: float) -> str:
    return f"{value:.12g}"
