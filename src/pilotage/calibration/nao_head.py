# SPDX-License-Identifier: Apache-2.0
"""The Nao's head as its maker gives it: its cameras, its angles, how far its shell lets it turn."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pilotage import Transform

HEAD_Z_M = 0.1265  # from the torso to both axes of the neck
# In the head's frame, versions 4 and 5 of the robot: x, z (m), pitch (rad, positive down).
CAMERAS = {"top": (0.05871, 0.06364, 0.0209), "bottom": (0.05071, 0.01774, 0.6929)}
FIELD_OF_VIEW_DEG = (60.9, 47.6)
YAW_LIMIT_RAD = 2.0857
PITCH_LIMITS_RAD = (-0.6720, 0.5149)
SPEED_RAD_S = 2.0
# What joints and legs leave unsure: half the play of the gears and the encoders' steps; the seat of
# the cameras on a head of plastic.
JOINT_SIGMA_RAD, SEAT_SIGMA_RAD, SEAT_SIGMA_M = 0.002, 0.001, 0.001
# The maker's table: at a yaw to either side (deg) the shell allows these pitches (deg).
SHELL_DEG = (
    (0.0, -38.50, 29.50),
    (27.85, -38.50, 24.18),
    (43.32, -31.40, 21.20),
    (51.74, -27.50, 18.91),
    (62.45, -24.64, 17.19),
    (87.49, -18.91, 11.46),
    (119.52, -25.73, 18.91),
)


class HeadAngles(NamedTuple):
    """Radians; yaw is positive to the left, pitch positive downward."""

    yaw_rad: float
    pitch_rad: float

    def turned(self, goal: HeadAngles, duration_s: float) -> HeadAngles:
        """Return where the head is on its way to `goal` after a time, within the shell."""
        way = SPEED_RAD_S * duration_s
        yaw = toward(self.yaw_rad, goal.yaw_rad, way)
        return clamped(HeadAngles(yaw, toward(self.pitch_rad, goal.pitch_rad, way)))


def torso_from_neck(yaw_rad: float) -> Transform:
    """Return where the frame is that turns with the head's yaw alone; torso axes as `robot`."""
    half = yaw_rad / 2
    return Transform(
        translation_m=[0.0, 0.0, HEAD_Z_M], quaternion_wxyz=[math.cos(half), 0, 0, math.sin(half)]
    )


def neck_from_head(pitch_rad: float) -> Transform:
    """Return where the head is on the neck: both axes meet in one point."""
    half = pitch_rad / 2
    return Transform(quaternion_wxyz=[math.cos(half), 0, math.sin(half), 0])


def head_from_camera(name: str) -> Transform:
    """Return where `top` or `bottom` sits on the head; its axes are x right, y down, z forward."""
    x_m, z_m, pitch_rad = CAMERAS[name]
    seat = Transform(translation_m=[x_m, 0.0, z_m]) @ neck_from_head(pitch_rad)
    return seat @ Transform(quaternion_wxyz=[0.5, -0.5, 0.5, -0.5])


def neck_axes(yaw_rad: float) -> NDArray[np.float64]:
    """Return the axes of yaw and pitch at a yaw of the head, (2, 3), in the torso's frame.

    Both go through the neck, `HEAD_Z_M` above the torso.
    """
    return np.array([[0.0, 0.0, 1.0], [-math.sin(yaw_rad), math.cos(yaw_rad), 0.0]])


def seat_covariance(
    robot_from_camera: Transform, torso_from_camera: Transform, yaw_rad: float
) -> NDArray[np.float64]:
    """Return how unsure joints leave `robot_from_camera` at a yaw of the head, (6, 6).

    Of the place in the robot's axes, m, then the turn about the camera's own axes, rad. Both
    joints turn the camera about the neck.
    """
    from_neck = np.array(torso_from_camera.translation_m) - [0.0, 0.0, HEAD_Z_M]
    to_camera = robot_from_camera.matrix()[:3, :3].T
    covariance = np.diag([SEAT_SIGMA_M**2] * 3 + [SEAT_SIGMA_RAD**2] * 3)
    for axis in neck_axes(yaw_rad):
        moved = np.concatenate([np.cross(axis, from_neck), to_camera @ axis])
        covariance += JOINT_SIGMA_RAD**2 * np.outer(moved, moved)
    return covariance


def pitch_limits_rad(yaw_rad: float) -> tuple[float, float]:
    """Return lowest and highest pitch that joint and shell allow at a yaw."""
    yaw, low, high = np.radians(np.array(SHELL_DEG)).T
    aside = abs(yaw_rad)
    limits = float(np.interp(aside, yaw, low)), float(np.interp(aside, yaw, high))
    return max(limits[0], PITCH_LIMITS_RAD[0]), min(limits[1], PITCH_LIMITS_RAD[1])


def clamped(head: HeadAngles) -> HeadAngles:
    """Return the nearest angles the head can take, yaw first."""
    yaw = min(max(head.yaw_rad, -YAW_LIMIT_RAD), YAW_LIMIT_RAD)
    low, high = pitch_limits_rad(yaw)
    return HeadAngles(yaw, min(max(head.pitch_rad, low), high))


def toward(value: float, goal: float, way: float) -> float:
    """Return `value` moved by `way` at most, exactly `goal` once it is that near."""
    return goal if abs(goal - value) <= way else value + math.copysign(way, goal - value)
