# SPDX-License-Identifier: Apache-2.0
"""Cameras and rigs built from numbers of a file, with the checks that hold for every style."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pilotage import Camera, StereoRig, Transform
from pilotage.calibration.document import Section
from pilotage.errors import InputError

READOUT = "readout_s"  # what files call the time from a rolling shutter's first row to its last
LARGEST_SIDE_PX = 16384
LARGEST_BASELINE_M = 10.0
ROTATION_TOLERANCE = 1e-3  # printed calibrations have 4 digits at least

# What the styles call a lens, and what it is here. Brown order: k1 k2 p1 p2 k3.
LENS_NAMES = {
    "none": "none",
    "plumb_bob": "brown",
    "radtan": "brown",
    "radial-tangential": "brown",
    "brown": "brown",
    "rational_polynomial": "rational",
    "equidistant": "kannala_brandt",
    "equi": "kannala_brandt",
    "fisheye": "kannala_brandt",
    "kannala_brandt": "kannala_brandt",
}


@dataclass(frozen=True)
class Lens:
    """Which model and its coefficients, in the order of `Camera`."""

    model: str
    coefficients: tuple[float, ...]


def read_lens(section: Section, model_key: str, coefficients_key: str) -> Lens:
    """Return the lens a section names; InputError when `Camera` cannot represent it."""
    name = section.text(model_key).lower() if model_key in section else "plumb_bob"
    if name not in LENS_NAMES and name != "":
        raise section.fault(model_key, f"unknown; must be one of {', '.join(LENS_NAMES)}")
    model = LENS_NAMES.get(name, "none")
    if model == "none":
        return Lens("none", ())
    if model == "kannala_brandt":
        return Lens(model, tuple(section.numbers(coefficients_key, [4])))
    allowed = [8, 12, 14] if model == "rational" else [0, 4, 5, 8, 12, 14]
    return brown_lens(section, coefficients_key, section.numbers(coefficients_key, allowed))


def brown_lens(section: Section, key: str, values: Sequence[float]) -> Lens:
    """Return k1 k2 p1 p2 [k3] as a lens; longer lists only when their excess is zero."""
    if any(values[5:]):
        raise section.fault(
            key,
            "a rational or prism lens (coefficients after the fifth) cannot be represented; "
            "calibrate with plumb_bob, or with equidistant for a wide lens",
        )
    if not any(values):
        return Lens("none", ())
    return Lens("brown", tuple(values[:5]))


def make_camera(
    section: Section, size_px: tuple[int, int], intrinsics_px: Sequence[float], lens: Lens
) -> Camera:
    """Return a camera; `intrinsics_px` are fx, fy, cx, cy in pixels, (0, 0) a pixel's centre."""
    fx, fy, cx, cy = intrinsics_px
    place = f"{section.file}: {section.where}{': ' if section.where else ''}"
    for name, focal in (("fx", fx), ("fy", fy)):
        if not 1 <= focal <= 1e6:
            raise InputError(f"{place}{name} = {focal} px: must lie from 1 to 1e6; calibrate again")
    for name, centre, side in (("cx", cx, size_px[0]), ("cy", cy, size_px[1])):
        if not -side <= centre <= 2 * side:
            raise InputError(
                f"{place}{name} = {centre} px: lies far outside a picture of {side} px; "
                "calibrate again"
            )
    try:
        return Camera(
            width_px=size_px[0], height_px=size_px[1], fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy,
            distortion=lens.model, coefficients=list(lens.coefficients),
        )  # fmt: skip
    except ValueError as error:
        raise InputError(f"{place}{error}; calibrate again") from None


def check_size(section: Section, width_px: float, height_px: float) -> tuple[int, int]:
    for side in (width_px, height_px):
        if side != int(side) or not 1 <= side <= LARGEST_SIDE_PX:
            raise InputError(
                f"{section.file}: {section.where or 'picture'}: size {width_px:g} x {height_px:g} "
                f"px: sides must be whole, from 1 to {LARGEST_SIDE_PX}"
            )
    return int(width_px), int(height_px)


def check_transform(file: Path, name: str, b_from_a: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return `b_from_a`, (4, 4), when it is a rigid transform; else InputError."""
    rotation = b_from_a[:3, :3]
    error = np.linalg.norm(rotation @ rotation.T - np.eye(3))
    if not error < ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
        raise InputError(
            f"{file}: {name}: its 3x3 part is not a rotation (off by {error:.2g}); "
            "copy the matrix with all its digits"
        )
    if np.abs(b_from_a[3] - [0, 0, 0, 1]).max() > 1e-9:
        raise InputError(f"{file}: {name}: its last row must be 0 0 0 1; correct it")
    return b_from_a


def make_rig(  # noqa: PLR0913, what a rig is made of
    file: Path,
    left: Camera,
    right: Camera,
    right_from_left: Transform,
    robot_from_left: Transform | None = None,
    *,
    readout_s: float = 0.0,
) -> StereoRig:
    """Return a rig after checking that the right camera lies to the right, at a sane distance."""
    matrix = right_from_left.matrix()
    right_in_left_m = -matrix[:3, :3].T @ matrix[:3, 3]
    baseline_m = float(np.linalg.norm(right_in_left_m))
    if not 1e-4 <= baseline_m <= LARGEST_BASELINE_M:
        raise InputError(
            f"{file}: baseline = {baseline_m:.6g} m: must lie from 0.0001 to "
            f"{LARGEST_BASELINE_M:g}; lengths are metres, not millimetres"
        )
    if right_in_left_m[0] <= 0:
        raise InputError(
            f"{file}: baseline = {right_in_left_m[0]:.6g} m along x: the right camera lies left "
            "of the left one; swap the two cameras or correct the sign"
        )
    if right_in_left_m[0] < 0.5 * baseline_m:
        raise InputError(
            f"{file}: the base of {baseline_m:.6g} m does not run along the left camera's x axis "
            f"({right_in_left_m.round(4).tolist()} m): only side-by-side pairs can be used"
        )
    try:
        return StereoRig(
            left=left,
            right=right,
            right_from_left=right_from_left,
            robot_from_left=robot_from_left,
            readout_s=readout_s,
        )
    except ValueError as error:
        raise InputError(f"{file}: {error}; calibrate again") from None
