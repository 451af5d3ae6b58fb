# SPDX-License-Identifier: Apache-2.0
"""What the faults do to a camera, a pair, and a calibration, at one moment."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from pilotage import StereoRig, Transform
from pilotage.simulation.faults import CAMERA, KINDS, Fault

LEFT_SUFFIX, RIGHT_SUFFIX = "_left", "_right"
# Rotation vector of a turn, and translation of a move, of 1 in the camera's frame.
TURNS = {"tilt_up": (1, 0, 0), "tilt_right": (0, 1, 0), "tilt_clockwise": (0, 0, 1)}
MOVES = {"shift_right": (1, 0, 0), "shift_down": (0, 1, 0), "shift_forward": (0, 0, 1)}


@dataclass(frozen=True)
class CameraActing:
    """What acts on one camera: shares 0 to 1, and where it is instead of where it was built in."""

    blind: float = 0.0
    dirt: float = 0.0
    glare: float = 0.0
    darkness: float = 0.0
    blur_px: float = 0.0
    dropped: float = 0.0
    delay_s: float = 0.0
    built_from_camera: Transform = field(default_factory=Transform)


@dataclass(frozen=True)
class PairActing:
    """What acts on a pair: how much older the right picture is, and the share that is swapped."""

    swapped: float = 0.0
    lag_frames: int = 0
    lag_s: float = 0.0


WELL, PAIR_WELL = CameraActing(), PairActing()


def acting_on_camera(faults: Sequence[Fault], camera: str, time_ns: int) -> CameraActing:
    """Return what all faults do to a camera: of one kind the strongest counts, moves add up."""
    active = [
        fault
        for fault in faults
        if KINDS[fault.name].part == CAMERA and fault.concerns(camera) and fault.is_active(time_ns)
    ]
    if not active:
        return WELL
    return CameraActing(
        blind=_strongest(active, "blind"),
        dirt=_strongest(active, "dirt"),
        glare=_strongest(active, "glare"),
        darkness=_strongest(active, "darkness"),
        blur_px=_strongest(active, "blur"),
        dropped=_strongest(active, "frames_dropped"),
        delay_s=_strongest(active, "frames_delayed") * 1e-3,
        built_from_camera=_mount(active),
    )


def acting_on_pair(faults: Sequence[Fault], pair: str, time_ns: int) -> PairActing:
    """Return what all faults do to a pair, `front` say."""
    active = [f for f in faults if f.concerns(pair) and f.is_active(time_ns)]
    if not active:
        return PAIR_WELL
    return PairActing(
        swapped=_strongest(active, "swapped"),
        lag_frames=round(sum(f.size for f in active if f.name == "out_of_step_frames")),
        lag_s=sum(f.size for f in active if f.name == "out_of_step_ms") * 1e-3,
    )


def written_rig(rig: StereoRig, faults: Sequence[Fault], pair: str) -> StereoRig:
    """Return the calibration as it is written down: that of `rig`, with the faults' errors."""
    base, square = (
        math.prod(f.size for f in faults if f.name == name and f.concerns(pair))
        for name in ("wrong_base", "wrong_square")
    )
    robot_from_left = rig.robot_from_left
    if robot_from_left is not None:
        robot_from_left = _scaled(robot_from_left, square)
    return StereoRig(
        left=rig.left,
        right=rig.right,
        right_from_left=_scaled(rig.right_from_left, base * square),
        robot_from_left=robot_from_left,
        readout_s=rig.readout_s,
    )


def pairs_of(cameras: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return the pairs among cameras, name -> (left, right): `front` of `front_left`, ..."""
    stems = [c.removesuffix(LEFT_SUFFIX) for c in cameras if c.endswith(LEFT_SUFFIX)]
    return {
        stem: (stem + LEFT_SUFFIX, stem + RIGHT_SUFFIX)
        for stem in stems
        if stem + RIGHT_SUFFIX in cameras
    }


def _strongest(active: Sequence[Fault], name: str) -> float:
    return max((float(fault.size) for fault in active if fault.name == name), default=0.0)


def _mount(active: Sequence[Fault]) -> Transform:
    turn_rad, move_m = [0.0] * 3, [0.0] * 3
    for fault in active:
        for axis in range(3):
            turn_rad[axis] += math.radians(fault.size) * TURNS.get(fault.name, (0, 0, 0))[axis]
            move_m[axis] += 1e-3 * fault.size * MOVES.get(fault.name, (0, 0, 0))[axis]
    angle_rad = math.hypot(*turn_rad)
    half = math.sin(angle_rad / 2) / angle_rad if angle_rad > 0 else 0.5
    quaternion = [math.cos(angle_rad / 2), *(half * part for part in turn_rad)]
    return Transform(translation_m=move_m, quaternion_wxyz=quaternion)


def _scaled(transform: Transform, factor: float) -> Transform:
    return Transform(
        translation_m=(factor * transform.translation_m).tolist(),
        quaternion_wxyz=transform.quaternion_wxyz.tolist(),
    )
