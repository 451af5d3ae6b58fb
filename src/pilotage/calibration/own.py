# SPDX-License-Identifier: Apache-2.0
"""Our own calibration style: named keys, a unit on every number, an exact round trip.

left: {width_px: 752, height_px: 480, fx_px: 458.654, fy_px: 457.296, cx_px: 367.215,
       cy_px: 248.375, distortion: brown, coefficients: {k1: -0.283, k2: 0.074, ...}}
right: ...
right_from_left: {translation_m: [-0.11, 0, 0], quaternion_wxyz: [1, 0, 0, 0]}
robot_from_left: ...    # optional
readout_s: 0.016        # optional: a rolling shutter, from the first row to the last
"""

from __future__ import annotations

from typing import Any

import numpy as np
import yaml

from pilotage import Camera, StereoRig, Transform
from pilotage.calibration.document import Section
from pilotage.calibration.rig import READOUT, Lens, check_size, make_camera, make_rig

COEFFICIENTS = {
    "none": (),
    "brown": ("k1", "k2", "p1", "p2", "k3"),
    "kannala_brandt": ("k1", "k2", "k3", "k4"),
}
INTRINSICS = ("fx_px", "fy_px", "cx_px", "cy_px")
TRANSFORM_KEYS = ("translation_m", "quaternion_wxyz")
# A quaternion printed with few digits is normalised; one further off is a typing error.
NORM_TOLERANCE = 1e-3


def is_own(section: Section) -> bool:
    """Tell our own style by its keys, one of them misspelt or not."""
    left = section.values.get("left")
    return "right_from_left" in section or (isinstance(left, dict) and "fx_px" in left)


def read_own(section: Section) -> StereoRig:
    """Return the rig of a file in our own style, or of a part of one."""
    section.refuse_unknown(["left", "right", "right_from_left", "robot_from_left", READOUT])
    robot_from_left = None
    if "robot_from_left" in section:
        robot_from_left = _read_transform(section.section("robot_from_left"))
    return make_rig(
        section.file,
        read_camera(section.section("left")),
        read_camera(section.section("right")),
        _read_transform(section.section("right_from_left")),
        robot_from_left,
        readout_s=section.number(READOUT) if READOUT in section else 0.0,
    )


def write_own(rig: StereoRig) -> str:
    """Return the text of a rig; floats keep every digit."""
    header = "# Stereo rig of Pilotage. Pixel (0, 0) is the centre of the first pixel.\n"
    return header + yaml.safe_dump(own_values(rig), sort_keys=False, default_flow_style=None)


def own_values(rig: StereoRig) -> dict[str, Any]:
    """Return a rig as the values of its keys."""
    document: dict[str, Any] = {
        "left": camera_values(rig.left),
        "right": camera_values(rig.right),
        "right_from_left": _transform_values(rig.right_from_left),
    }
    if rig.robot_from_left is not None:
        document["robot_from_left"] = _transform_values(rig.robot_from_left)
    if rig.readout_s:
        document[READOUT] = rig.readout_s
    return document


def read_camera(section: Section) -> Camera:
    """Return a camera of our own style."""
    section.refuse_unknown(["width_px", "height_px", *INTRINSICS, "distortion", "coefficients"])
    model = section.text("distortion") if "distortion" in section else "none"
    if model not in COEFFICIENTS:
        raise section.fault("distortion", f"must be one of {', '.join(COEFFICIENTS)}")
    coefficients: tuple[float, ...] = ()
    if COEFFICIENTS[model]:
        named = section.section("coefficients")
        named.refuse_unknown(COEFFICIENTS[model])
        coefficients = tuple(named.number(name) for name in COEFFICIENTS[model])
    elif section.values.get("coefficients"):
        raise section.fault("coefficients", "a lens without distortion has none; remove them")
    size_px = check_size(section, section.number("width_px"), section.number("height_px"))
    intrinsics_px = [section.number(key) for key in INTRINSICS]
    return make_camera(section, size_px, intrinsics_px, Lens(model, coefficients))


def _read_transform(section: Section) -> Transform:
    section.refuse_unknown(TRANSFORM_KEYS)
    translation_m = section.numbers("translation_m", [3])
    quaternion_wxyz = section.numbers("quaternion_wxyz", [4])
    if abs(np.linalg.norm(quaternion_wxyz) - 1) > NORM_TOLERANCE:
        raise section.fault("quaternion_wxyz", "must have length 1; correct it")
    return Transform(translation_m=translation_m, quaternion_wxyz=quaternion_wxyz)


def camera_values(camera: Camera) -> dict[str, Any]:
    """Return a camera as the values of its keys."""
    names = COEFFICIENTS[camera.distortion]
    values: dict[str, Any] = {"width_px": camera.width_px, "height_px": camera.height_px}
    values |= {key: float(getattr(camera, key)) for key in INTRINSICS}
    values["distortion"] = camera.distortion
    if names:
        pairs = zip(names, camera.coefficients, strict=False)
        values["coefficients"] = {name: float(value) for name, value in pairs}
    return values


def _transform_values(transform: Transform) -> dict[str, list[float]]:
    return {
        "translation_m": np.asarray(transform.translation_m).tolist(),
        "quaternion_wxyz": np.asarray(transform.quaternion_wxyz).tolist(),
    }
