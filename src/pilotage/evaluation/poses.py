# SPDX-License-Identifier: Apache-2.0
"""Arrays of rigid transforms, (N, 4, 4): inverses, interpolation, alignment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

Array = NDArray[np.float64]


def pose_matrices(positions_m: Array, quaternions_wxyz: Array) -> Array:
    """Return (N, 4, 4) transforms of (N, 3) positions and (N, 4) quaternions of any length."""
    poses = np.tile(np.eye(4), (len(positions_m), 1, 1))
    if len(positions_m):
        rotations = Rotation.from_quat(quaternions_wxyz, scalar_first=True)
        poses[:, :3, :3] = rotations.as_matrix()
        poses[:, :3, 3] = positions_m
    return poses


def inverse(poses: Array) -> Array:
    """Return `a_from_b` of `b_from_a`, shape (..., 4, 4)."""
    inverted = np.zeros_like(poses)
    turned = np.swapaxes(poses[..., :3, :3], -1, -2)
    inverted[..., :3, :3] = turned
    inverted[..., :3, 3] = -np.einsum("...ij,...j->...i", turned, poses[..., :3, 3])
    inverted[..., 3, 3] = 1.0
    return inverted


def rotation_vectors(rotations: Array) -> Array:
    """Return (N, 3) axes times angles, radians, of (N, 3, 3) rotations; angles in [0, pi]."""
    if len(rotations) == 0:
        return np.zeros((0, 3))
    return np.asarray(Rotation.from_matrix(rotations).as_rotvec(), dtype=np.float64)


def interpolate(
    *, times_ns: NDArray[np.int64], poses: Array, at_ns: NDArray[np.int64], widest_gap_ns: int
) -> Array:
    """Return (M, 4, 4) poses at `at_ns`, NaN outside `times_ns` and inside gaps that are too wide.

    Positions go straight, rotations by slerp. `times_ns` (N,) increases strictly. A time within
    a millisecond of a sample takes the sample, so that text rounded to microseconds still meets.
    """
    result = np.full((len(at_ns), 4, 4), np.nan)
    if len(times_ns) == 0:
        return result
    after = np.clip(np.searchsorted(times_ns, at_ns), 0, len(times_ns) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(at_ns - times_ns[before] < times_ns[after] - at_ns, before, after)
    meets = np.abs(times_ns[nearest] - at_ns) <= 1_000_000
    inside = (times_ns[before] <= at_ns) & (at_ns <= times_ns[after])
    between = inside & (times_ns[after] - times_ns[before] <= widest_gap_ns)
    result[meets] = poses[nearest[meets]]
    if between.any():
        # Relative to the first sample: doubles hold a span to the nanosecond, not an epoch.
        origin = times_ns[0]
        slerp = Slerp((times_ns - origin) * 1e-9, Rotation.from_matrix(poses[:, :3, :3]))
        wanted_s = (at_ns[between] - origin) * 1e-9
        result[between] = np.eye(4)
        result[between, :3, :3] = slerp(wanted_s).as_matrix()
        share = (at_ns - times_ns[before]) / np.maximum(times_ns[after] - times_ns[before], 1)
        step = poses[after, :3, 3] - poses[before, :3, 3]
        result[between, :3, 3] = (poses[before, :3, 3] + share[:, None] * step)[between]
    return result


def way_m(positions_m: Array) -> Array:
    """Return the (N,) way since the first of (N, 3) positions; NaN where there is none."""
    known = np.isfinite(positions_m).all(axis=1)
    way = np.full(len(positions_m), np.nan)
    steps = np.linalg.norm(np.diff(positions_m[known], axis=0), axis=1)
    way[known] = np.concatenate([[0.0], np.cumsum(steps)])[: known.sum()]
    return way


@dataclass(frozen=True)
class Similarity:
    """`point_in_b = scale * rotation @ point_in_a + translation`."""

    rotation: Array
    translation: Array
    scale: float = 1.0

    def apply(self, poses: Array) -> Array:
        """Return `b_from_c` (N, 4, 4) of `a_from_c`; the scale acts on positions only."""
        moved = poses.copy()
        moved[:, :3, :3] = self.rotation @ poses[:, :3, :3]
        moved[:, :3, 3] = self.scale * poses[:, :3, 3] @ self.rotation.T + self.translation
        return moved


def align(*, points_in_a: Array, points_in_b: Array, with_scale: bool = False) -> Similarity:
    """Return the `b_from_a` that fits (N, 3) points best in least squares (Umeyama 1991).

    Points on one line are fitted as well: the turn about the line, which they leave open, is the
    smallest one. (evo refuses them; otherwise the two agree, which a test holds.)
    """
    mean_a, mean_b = points_in_a.mean(axis=0), points_in_b.mean(axis=0)
    centred_a, centred_b = points_in_a - mean_a, points_in_b - mean_b
    u, singular, vt = np.linalg.svd(centred_b.T @ centred_a)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    rotation = u @ np.diag(signs) @ vt
    spread = float((centred_a**2).sum())
    scale = float((singular * signs).sum()) / spread if with_scale and spread > 0 else 1.0
    return Similarity(rotation, mean_b - scale * rotation @ mean_a, scale)
