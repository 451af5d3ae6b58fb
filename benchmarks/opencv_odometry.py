# SPDX-License-Identifier: Apache-2.0
"""The yardstick: stereo odometry as one would glue it together from OpenCV's parts.

Rectify, Harris points, SIFT descriptors at them, matches along the epipolar line and from the
previous pair, space intersection, PnP with RANSAC, refinement. No window, no map. It is kept as
good as its parts allow, because a weak yardstick would flatter Pilotage.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class OpencvConfig:
    """What a user would tune; the values here did best on `kitti_a` at a bearable cost."""

    corners: int = 800
    corner_distance_px: float = 8.0
    corner_quality: float = 1e-4
    descriptor_size_px: float = 4.0
    epipolar_tolerance_px: float = 1.0
    max_disparity_px: float = 160.0
    search_radius_px: float = 160.0
    ratio: float = 0.85
    reprojection_px: float = 1.0
    min_matches: int = 12


@dataclass
class _Pair:
    """Left points and what is known of them: pixels (N, 2), descriptors (N, 128), points (N, 3)."""

    pixels: Array
    descriptors: Array
    points_in_left: Array  # metres; NaN where the right picture has no match


class OpencvOdometry:
    """Frame-to-frame odometry of a calibrated stereo pair; `rig` is a `pilotage.StereoRig`."""

    def __init__(self, rig: Any, config: OpencvConfig | None = None) -> None:
        self._config = config or OpencvConfig()
        self._sift = cv2.SIFT_create()
        self._matcher = cv2.BFMatcher(cv2.NORM_L2)
        self._maps, self._left_matrix, self._right_matrix = _rectification(rig)
        self._previous: _Pair | None = None
        self._world_from_left = np.eye(4)

    def track(self, left: Array, right: Array) -> Array | None:
        """Return (4, 4) world_from_left of this pair, None when lost; pictures (H, W) uint8."""
        pair = self._observe(*self._rectify(left, right))
        previous, self._previous = self._previous, pair
        if previous is None:
            return self._world_from_left.copy()
        current_from_previous = self._solve(previous, pair)
        if current_from_previous is None:
            return None
        self._world_from_left = self._world_from_left @ np.linalg.inv(current_from_previous)
        return self._world_from_left.copy()

    def _rectify(self, left: Array, right: Array) -> tuple[Array, Array]:
        if self._maps is None:
            return left, right
        (left_x, left_y), (right_x, right_y) = self._maps
        return (
            cv2.remap(left, left_x, left_y, cv2.INTER_LINEAR),
            cv2.remap(right, right_x, right_y, cv2.INTER_LINEAR),
        )

    def _observe(self, left: Array, right: Array) -> _Pair:
        left_px, left_descriptors = self._describe(left)
        right_px, right_descriptors = self._describe(right)
        points = np.full((len(left_px), 3), np.nan)
        if len(left_px) and len(right_px):
            allowed = self._epipolar_mask(left_px, right_px)
            i, j = self._match(left_descriptors, right_descriptors, allowed)
            points[i] = self._intersect(left_px[i], right_px[j])
        return _Pair(left_px, left_descriptors, points)

    def _describe(self, image: Array) -> tuple[Array, Array]:
        """Return (N, 2) Harris points to a fraction of a pixel and their (N, 128) descriptors."""
        config = self._config
        corners = cv2.goodFeaturesToTrack(
            image,
            config.corners,
            config.corner_quality,
            config.corner_distance_px,
            useHarrisDetector=True,
        )
        if corners is None:
            return np.empty((0, 2), np.float32), np.empty((0, 128), np.float32)
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.01)
        corners = cv2.cornerSubPix(image, corners, (3, 3), (-1, -1), criteria)
        keypoints = [
            cv2.KeyPoint(float(x), float(y), config.descriptor_size_px, 0.0)
            for x, y in corners.reshape(-1, 2)
        ]
        keypoints, descriptors = self._sift.compute(image, keypoints)
        return np.array([k.pt for k in keypoints], np.float32).reshape(-1, 2), descriptors

    def _epipolar_mask(self, left_px: Array, right_px: Array) -> Array:
        """Return the (N, M) uint8 mask of pairs on one row with a possible disparity."""
        config = self._config
        principal_shift = self._left_matrix[0, 2] - self._right_matrix[0, 2]
        disparity = left_px[:, None, 0] - right_px[None, :, 0] - principal_shift
        parallax_y = np.abs(left_px[:, None, 1] - right_px[None, :, 1])
        allowed = (disparity > 0.5) & (disparity < config.max_disparity_px)
        return (allowed & (parallax_y < config.epipolar_tolerance_px)).astype(np.uint8)

    def _match(self, a: Array, b: Array, allowed: Array) -> tuple[Array, Array]:
        """Return indices (K,), (K,) of matches that pass the ratio test and are mutually best."""
        forward = self._matcher.knnMatch(a, b, 2, allowed)
        backward = self._matcher.match(b, a, allowed.T.copy())
        best_back = {m.queryIdx: m.trainIdx for m in backward}
        matches = [
            (m[0].queryIdx, m[0].trainIdx)
            for m in forward
            if m
            and (len(m) < 2 or m[0].distance < self._config.ratio * m[1].distance)
            and best_back.get(m[0].trainIdx) == m[0].queryIdx
        ]
        pairs = np.array(matches, int).reshape(-1, 2)
        return pairs[:, 0], pairs[:, 1]

    def _intersect(self, left_px: Array, right_px: Array) -> Array:
        """Return (K, 3) points in the left camera, metres."""
        if not len(left_px):
            return np.empty((0, 3))
        homogeneous = cv2.triangulatePoints(
            self._left_matrix, self._right_matrix, left_px.T.copy(), right_px.T.copy()
        )
        return (homogeneous[:3] / homogeneous[3]).T.astype(float)

    def _solve(self, previous: _Pair, current: _Pair) -> Array | None:
        """Return (4, 4) current_from_previous by PnP of the previous points; None when lost."""
        if not len(previous.pixels) or not len(current.pixels):
            return None
        radius = self._config.search_radius_px
        shift_x, shift_y = (
            previous.pixels[:, None, k] - current.pixels[None, :, k] for k in (0, 1)
        )
        near = (np.abs(shift_x) < radius) & (np.abs(shift_y) < radius)
        known = np.isfinite(previous.points_in_left[:, 0])
        allowed = (near & known[:, None]).astype(np.uint8)
        i, j = self._match(previous.descriptors, current.descriptors, allowed)
        if len(i) < self._config.min_matches:
            return None
        return self._resect(previous.points_in_left[i], current.pixels[j].astype(float))

    def _resect(self, points: Array, pixels: Array) -> Array | None:
        camera_matrix = self._left_matrix[:, :3]
        found, rotation, translation, inliers = cv2.solvePnPRansac(
            points,
            pixels,
            camera_matrix,
            None,
            iterationsCount=200,
            reprojectionError=self._config.reprojection_px,
            confidence=0.999,
            flags=cv2.SOLVEPNP_P3P,
        )
        if not found or inliers is None or len(inliers) < self._config.min_matches:
            return None
        kept = inliers.ravel()
        rotation, translation = cv2.solvePnPRefineLM(
            points[kept], pixels[kept], camera_matrix, None, rotation, translation
        )
        current_from_previous = np.eye(4)
        current_from_previous[:3, :3] = cv2.Rodrigues(rotation)[0]
        current_from_previous[:3, 3] = translation.ravel()
        return current_from_previous


def _camera_matrix(camera: Any) -> Array:
    return np.array(
        [[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]], float
    )


def _rectification(rig: Any) -> tuple[Any, Array, Array]:
    """Return maps (x, y) a side or None, then the projections (3, 4) of left and right, pixels."""
    left_matrix, right_matrix = _camera_matrix(rig.left), _camera_matrix(rig.right)
    right_from_left = np.asarray(rig.right_from_left.matrix(), float)
    left_lens, right_lens = (np.asarray(c.coefficients, float) for c in (rig.left, rig.right))
    rotated = np.abs(right_from_left[:3, :3] - np.eye(3)).max() > 1e-9
    if not (rotated or left_lens.any() or right_lens.any()):
        left = np.hstack([left_matrix, np.zeros((3, 1))])
        return None, left, right_matrix @ right_from_left[:3]
    size = (rig.left.width_px, rig.left.height_px)
    turn_left, turn_right, left, right, *_ = cv2.stereoRectify(
        left_matrix,
        left_lens,
        right_matrix,
        right_lens,
        size,
        right_from_left[:3, :3],
        right_from_left[:3, 3:],
        flags=cv2.CALIB_ZERO_DISPARITY,
        alpha=0,
    )
    maps = tuple(
        cv2.initUndistortRectifyMap(matrix, lens, turn, projection, size, cv2.CV_16SC2)
        for matrix, lens, turn, projection in (
            (left_matrix, left_lens, turn_left, left),
            (right_matrix, right_lens, turn_right, right),
        )
    )
    return maps, left, right
