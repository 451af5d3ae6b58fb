# SPDX-License-Identifier: Apache-2.0
"""Small reconstructions whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from pilotage import Camera, Transform
from pilotage.models import Model


def camera(distortion: str = "none", coefficients: list[float] | None = None) -> Camera:
    return Camera(
        width_px=640, height_px=480, fx_px=500.0, fy_px=510.0, cx_px=321.5, cy_px=238.25,
        distortion=distortion, coefficients=coefficients or [],
    )  # fmt: skip


def a_model(lens: Camera | None = None, noise_px: float = 0.3, seed: int = 5) -> Model:
    """Return five pictures of two cameras before a cloud; some points are not seen by some."""
    random = np.random.default_rng(seed)
    cameras = (lens or camera(), camera("brown", [-0.1, 0.01, 0.0, 0.0]))
    points = random.uniform((-1.5, -1, 4), (1.5, 1, 7), (60, 3))
    poses, index = [], [0, 1, 0, 0, 1]
    for i in range(5):
        x, y, z, w = Rotation.from_rotvec(random.normal(0, 0.05, 3)).as_quat()
        move = (-0.3 * i, 0.05 * i, 0.02)
        poses.append(Transform(translation_m=move, quaternion_wxyz=(w, x, y, z)))
    picture, point, pixel = [], [], []
    for i, pose in enumerate(poses):
        matrix = pose.matrix()
        seen = np.flatnonzero(random.random(len(points)) < 0.7)
        in_camera = points[seen] @ matrix[:3, :3].T + matrix[:3, 3]
        picture.append(np.full(len(seen), i))
        point.append(seen)
        pixel.append(cameras[index[i]].project(in_camera) + random.normal(0, noise_px, (1, 2)))
    shuffled = random.permutation(sum(map(len, point)))
    return Model(
        cameras=cameras,
        names=tuple(f"{i}.jpg" for i in range(5)),
        camera_index=np.array(index),
        camera_from_world=tuple(poses),
        points_in_world=points,
        colors=random.integers(0, 256, (len(points), 3)).astype(np.uint8),
        picture=np.concatenate(picture)[shuffled],
        point=np.concatenate(point)[shuffled],
        pixel_px=np.concatenate(pixel)[shuffled],
    )


def bare(model: Model) -> Model:
    """Return the model without points."""
    none = np.zeros(0, np.int64)
    return replace(
        model, points_in_world=np.zeros((0, 3)), colors=np.zeros((0, 3), np.uint8),
        picture=none, point=none, pixel_px=np.zeros((0, 2)),
    )  # fmt: skip
