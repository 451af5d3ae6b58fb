# SPDX-License-Identifier: Apache-2.0
"""The yardstick that looks down: one camera over ground that is taken to be flat.

As optical-flow sensors of robots work: the camera's height is known, pitch and roll are taken to be
zero, and the picture of the plane below is followed. Made as good as its assumption allows, because
a weak yardstick would flatter Pilotage: it knows lens and rolling shutter, follows corners from a
keyframe, predicts, and throws out what does not move with the ground.
"""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from pilotage import _core

Array = npt.NDArray[Any]

# Corners are at least a part of the picture's width apart.
CORNERS, CORNER_DISTANCE, CORNER_QUALITY = 400, 1 / 64, 0.005
THERE_AND_BACK_PX, FEWEST, FEW = 0.3, 20, 80
# A keyframe gives way once the ground has moved by this part of the picture, or turned so far.
FARTHEST, FARTHEST_TURN_RAD = 0.35, math.radians(12)


class FlatGroundOdometry:
    """World-from-robot in the plane from the left picture of a pair that looks straight down.

    `rig` is a `pilotage.StereoRig` with `robot_from_left`; the robot's origin is on the ground.
    Motions are (x m, y m, yaw rad).
    """

    def __init__(self, rig: Any) -> None:
        self._pixel_m = float(rig.robot_from_left.translation_m[2]) / rig.left.fx_px
        self._middle_m = np.asarray(rig.robot_from_left.translation_m[:2], float)
        self._size = (rig.left.width_px, rig.left.height_px)
        # Windows, levels and outliers fit pictures that are 640 wide, and are less in smaller ones.
        width = rig.left.width_px
        self._window_px = max(11, width // 30) | 1
        self._levels = max(1, round(math.log2(width / 80)))
        self._inlier_px = max(1.0, width / 320)
        self._maps = self._ground_maps(rig)
        seconds = (self._maps[1] / (rig.left.height_px - 1) - 0.5) * rig.readout_s
        self._row_s = seconds.astype(np.float32)
        self._previous: Array | None = None
        self._key: Array | None = None
        self._key_px = self._key_m = np.empty((0, 2))
        self._world_from_key = self._world_from_robot = np.zeros(3)
        self._velocity = np.zeros(3)  # of the robot in its own frame, a second
        self._stamp_ns = 0

    def track(self, left: Array, stamp_ns: int) -> Array | None:
        """Return (4, 4) world_from_robot, None when lost; `left` is (H, W) uint8."""
        ground = cv2.remap(left, *self._maps, cv2.INTER_CUBIC)
        passed_s, previous = (stamp_ns - self._stamp_ns) / 1e9, self._previous
        self._stamp_ns, self._previous = stamp_ns, ground
        if previous is None:
            self._make_key(ground)
            return _matrix(self._world_from_robot)
        before = self._world_from_robot
        predicted = _compose(before, self._velocity * passed_s)
        key_from_robot = self._follow(ground, predicted, passed_s)
        if key_from_robot is None and self._key is not previous:
            self._make_key(previous)
            key_from_robot = self._follow(ground, predicted, passed_s)
        if key_from_robot is None:
            self._world_from_robot = predicted
            self._make_key(ground)
            return None
        self._world_from_robot = _compose(self._world_from_key, key_from_robot)
        self._velocity = _between(before, self._world_from_robot) / passed_s
        if self._is_far(key_from_robot):
            self._make_key(ground)
        return _matrix(self._world_from_robot)

    def _ground_maps(self, rig: Any) -> tuple[Array, Array]:
        """Return x and y, (H, W), of the camera's pixels that see each pixel of the ground."""
        pixels = np.stack(np.meshgrid(*map(np.arange, self._size)), axis=-1).reshape(-1, 2)
        points = np.concatenate([self._to_m(pixels), np.zeros((len(pixels), 1))], axis=1)
        left_from_robot = rig.robot_from_left.inverse().matrix()
        in_left = points @ left_from_robot[:3, :3].T + left_from_robot[:3, 3]
        seen = np.asarray(rig.left.project(np.ascontiguousarray(in_left)), np.float32)
        maps = np.nan_to_num(seen, nan=-1e4).reshape(*self._size[::-1], 2)
        return np.ascontiguousarray(maps[..., 0]), np.ascontiguousarray(maps[..., 1])

    def _to_m(self, pixels: Array) -> Array:
        """Return where pixels (N, 2) of the ground lie: x up in the picture, y to its left."""
        centre = (np.array(self._size) - 1) / 2
        return self._middle_m - (np.asarray(pixels, float) - centre)[:, ::-1] * self._pixel_m

    def _to_px(self, points_m: Array) -> Array:
        centre = (np.array(self._size) - 1) / 2
        return centre - (points_m - self._middle_m)[:, ::-1] / self._pixel_m

    def _at_middle_row(self, pixels: Array, velocity: Array) -> Array:
        """Return where points of the ground lay when the middle row was taken, metres."""
        columns, rows = np.rint(pixels).astype(int).T
        width, height = self._size
        late_s = self._row_s[rows.clip(0, height - 1), columns.clip(0, width - 1)]
        points, turns = self._to_m(pixels), late_s * velocity[2]
        turned = points + turns[:, None] * np.stack([-points[:, 1], points[:, 0]], axis=1)
        return turned + late_s[:, None] * velocity[:2]

    def _make_key(self, ground: Array) -> None:
        apart_px = CORNER_DISTANCE * self._size[0]
        corners = cv2.goodFeaturesToTrack(ground, CORNERS, CORNER_QUALITY, apart_px)
        self._key = ground
        self._key_px = np.empty((0, 2)) if corners is None else corners.reshape(-1, 2)
        self._key_m = self._at_middle_row(self._key_px, self._velocity)
        self._world_from_key = self._world_from_robot

    def _is_far(self, key_from_robot: Array) -> bool:
        moved = self._to_px(_apply(key_from_robot, self._middle_m[None])) - self._to_px(
            self._middle_m[None]
        )
        far = np.abs(moved[0]) > FARTHEST * np.array(self._size)
        return bool(far.any() or abs(key_from_robot[2]) > FARTHEST_TURN_RAD or self._found < FEW)

    def _follow(self, ground: Array, predicted: Array, passed_s: float) -> Array | None:
        """Return key_from_robot; where the prediction fails, from the turn and shift of all."""
        found = self._match(ground, _between(self._world_from_key, predicted))
        if found is None:
            centre = (np.array(self._size) - 1) / 2
            for motion in _core.find_plane_motions(
                reference=self._key, current=ground, centre_px=centre
            ):
                found = self._match(ground, self._motion_of(motion))
                if found is not None:
                    break
        if found is None:
            return None
        in_key, in_robot = found
        velocity = self._velocity
        for _ in range(2):  # the rows' motion follows from what is found
            key_from_robot = _rigid(self._at_middle_row(in_robot, velocity), self._key_m[in_key])
            now = _compose(self._world_from_key, key_from_robot)
            velocity = _between(self._world_from_robot, now) / passed_s
        return key_from_robot

    def _motion_of(self, motion: Any) -> Array:
        """Return key_from_robot of a turn about the picture's centre and a shift of the ground."""
        # Pixels turn the other way round than x and y: both axes point against the robot's.
        turn = np.array([[math.cos(motion.turn_rad), -math.sin(motion.turn_rad)],
                         [math.sin(motion.turn_rad), math.cos(motion.turn_rad)]])  # fmt: skip
        centre = (np.array(self._size) - 1) / 2
        key_px = np.array([[0.0, 0.0], [100.0, 0.0], [0.0, 100.0]]) + centre
        return _rigid(
            self._to_m((key_px - centre) @ turn.T + centre + motion.shift_px), self._to_m(key_px)
        )

    def _match(self, ground: Array, guess: Array) -> tuple[Array, Array] | None:
        """Return indices of the key's corners and their pixels (N, 2) now; None for too few."""
        if len(self._key_px) < FEWEST:
            return None
        # As seen from where the key was taken, if the guess is right: what is left is small.
        corners = np.array([[0.0, 0.0], [100.0, 0.0], [0.0, 100.0]])
        current_px = self._to_px(_apply(_inverse(guess), self._to_m(corners)))
        current_from_key = cv2.getAffineTransform(
            corners.astype(np.float32), current_px.astype(np.float32)
        )
        flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
        moved = cv2.warpAffine(ground, current_from_key, self._size, flags=flags)
        options = {"winSize": (self._window_px,) * 2, "maxLevel": self._levels}
        start = self._key_px.astype(np.float32)
        there, is_there, _ = cv2.calcOpticalFlowPyrLK(self._key, moved, start, None, **options)
        back, is_back, _ = cv2.calcOpticalFlowPyrLK(moved, self._key, there, None, **options)
        now_px = there @ current_from_key[:, :2].T + current_from_key[:, 2]
        is_good = (is_there & is_back).ravel().astype(bool)
        is_good &= np.abs(back - start).max(axis=1) < THERE_AND_BACK_PX
        margin = self._window_px // 2
        is_good &= ((now_px > margin) & (now_px < np.array(self._size) - margin)).all(axis=1)
        kept = np.flatnonzero(is_good)
        if len(kept) < FEWEST:
            return None
        # A scale of its own, for ground that is nearer or farther than it is taken to be.
        _, inlier = cv2.estimateAffinePartial2D(
            now_px[kept], start[kept], ransacReprojThreshold=self._inlier_px
        )
        kept = kept[inlier.ravel().astype(bool)] if inlier is not None else kept[:0]
        self._found = len(kept)
        return (kept, now_px[kept]) if len(kept) >= FEWEST else None


def _rigid(points_in_b: Array, points_in_a: Array) -> Array:
    """Return the motion a_from_b that fits (N, 2) points best."""
    mean_b, mean_a = points_in_b.mean(axis=0), points_in_a.mean(axis=0)
    b, a = points_in_b - mean_b, points_in_a - mean_a
    cross = (b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0]).sum()
    turned = np.array([0.0, 0.0, math.atan2(cross, (a * b).sum())])
    shift = mean_a - _apply(turned, mean_b[None])[0]
    return np.array([*shift, turned[2]])


def _apply(motion: Array, points: Array) -> Array:
    c, s = math.cos(motion[2]), math.sin(motion[2])
    return points @ np.array([[c, s], [-s, c]]) + motion[:2]


def _compose(a_from_b: Array, b_from_c: Array) -> Array:
    return np.array([*_apply(a_from_b, b_from_c[None, :2])[0], a_from_b[2] + b_from_c[2]])


def _inverse(a_from_b: Array) -> Array:
    turned = np.array([0.0, 0.0, -a_from_b[2]])
    return np.array([*_apply(turned, -a_from_b[None, :2])[0], -a_from_b[2]])


def _between(world_from_a: Array, world_from_b: Array) -> Array:
    """Return a_from_b."""
    return _compose(_inverse(world_from_a), world_from_b)


def _matrix(motion: Array) -> Array:
    c, s = math.cos(motion[2]), math.sin(motion[2])
    matrix = np.eye(4)
    matrix[:2, :2] = [[c, -s], [s, c]]
    matrix[:2, 3] = motion[:2]
    return matrix
