# SPDX-License-Identifier: Apache-2.0
"""Rendered pictures: as exact as the camera model, and without a pattern that repeats."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pilotage import Camera, Transform, _core

Array = NDArray[np.float64]
SQUARE_M = 0.04
LENSES = {
    "none": [],
    "brown": [-0.28, 0.07, 0.0002, 0.00002, 0],
    "kannala_brandt": [0.01, -0.005, 0.002, 0],
}


def make_camera(distortion: str) -> Camera:
    return Camera(
        width_px=640,
        height_px=480,
        fx_px=430,
        fy_px=428,
        cx_px=322.3,
        cy_px=241.7,
        distortion=distortion,
        coefficients=LENSES[distortion],
    )


def make_board() -> _core.Scene:
    scene = _core.Scene()
    squares = _core.Material(albedo=0.9, checker_m=SQUARE_M, dark_albedo=0.05)
    scene.add_shape(
        kind=_core.ShapeKind.plane,
        size_m=[0.2, 0.16, 0],
        material=scene.add_material(squares),
        world_from_shape=Transform(),
    )
    scene.set_light(to_sun=[0, 0, 1], sun=0.6, sky=0.4, background=0.4)
    return scene


def camera_poses(count: int) -> list[Array]:
    """Return (4, 4) world_from_camera: 0.3 to 0.5 m before the board, tilted, turned, shifted."""
    random = np.random.default_rng(0)
    poses = []
    for _ in range(count):
        turn = Rotation.from_rotvec(random.normal(size=3) * [0.35, 0.35, 0.6]).as_matrix()
        camera_from_world = turn @ np.diag([1.0, -1.0, -1.0])
        board_m = np.append(random.uniform(-0.05, 0.05, 2), random.uniform(0.32, 0.5))
        pose = np.eye(4)
        pose[:3, :3] = camera_from_world.T
        pose[:3, 3] = -camera_from_world.T @ board_m
        poses.append(pose)
    return poses


def corner_errors(
    scene: _core.Scene, camera: Camera, pose: Array, radiance: NDArray[np.float32] | None = None
) -> Array:
    """Return (N, 2) found less projected corners, pixels."""
    if radiance is None:
        seen = _core.render(scene, _core.CameraRays(camera), Transform.from_matrix(pose))
        radiance = seen["radiance"]
    # A lens as sharp as its pixels: without one, steps between pixels are what is measured.
    sharp = cv2.GaussianBlur(radiance, (0, 0), 0.7)
    picture = np.round(np.clip(220 * sharp + 10, 0, 255)).astype(np.uint8)
    corners = SQUARE_M * np.array([[i, j, 0] for i in range(-4, 5) for j in range(-3, 4)])
    projected = camera.project((corners - pose[:3, 3]) @ pose[:3, :3])
    inside = np.all((projected > 12) & (projected < [627, 467]), axis=1)
    projected = projected[inside]
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 100, 1e-5)
    start = projected.astype(np.float32).reshape(-1, 1, 2).copy()
    found = cv2.cornerSubPix(picture, start, (5, 5), (-1, -1), stop).reshape(-1, 2)
    return found - projected


@pytest.mark.parametrize("distortion", list(LENSES))
def test_corners_are_where_the_camera_model_projects_them(distortion: str):
    scene, camera = make_board(), make_camera(distortion)
    errors = np.concatenate([corner_errors(scene, camera, pose) for pose in camera_poses(12)])
    assert len(errors) > 600
    assert np.sqrt(np.mean(errors**2)) <= 0.03
    assert np.abs(errors.mean(axis=0)).max() <= 0.005


def test_motion_blur_leaves_corners_where_they_are_in_the_middle_of_the_exposure():
    scene, camera = make_board(), make_camera("brown")
    rays, errors = _core.CameraRays(camera), []
    random = np.random.default_rng(1)
    for pose in camera_poses(12):
        # Over the exposure some 2 px by the turn and as much by the way.
        change = np.eye(4)
        change[:3, :3] = Rotation.from_rotvec(random.normal(size=3) * 0.003).as_matrix()
        change[:3, 3] = random.normal(size=3) * 0.001
        begin, end = pose @ np.linalg.inv(change), pose @ change
        exposure = _core.RowExposure(
            begin=Transform.from_matrix(begin),
            middle=Transform.from_matrix(pose),
            end=Transform.from_matrix(end),
        )
        seen = _core.render(scene, rays, _core.ShutterPoses(first=exposure))
        errors.append(corner_errors(scene, camera, pose, seen["radiance"]))
    together = np.concatenate(errors)
    assert len(together) > 600
    assert np.abs(np.median(together, axis=0)).max() <= 0.005
    assert np.abs([e.mean(axis=0) for e in errors]).max() <= 0.02


def rough_ground(side: int, texel_m: float) -> _core.Scene:
    """Return a plane made of white noise smoothed over two texels.

    Two layers of the same sample, a little apart in size: where one shows a place again, the other
    does not.
    """
    scene = _core.Scene()
    values = np.random.default_rng(1).normal(size=(side, side))
    values = cv2.GaussianBlur(np.tile(values, (3, 3)), (0, 0), 1.0)[
        side : 2 * side, side : 2 * side
    ]
    exemplar = scene.add_exemplar(np.ascontiguousarray(values / np.abs(values).max(), np.float32))
    layers = [
        _core.SurfaceLayer(exemplar=exemplar, amplitude=0.3, texel_m=size_m, seed=seed)
        for seed, size_m in enumerate((texel_m, 0.87 * texel_m))
    ]
    scene.add_shape(
        kind=_core.ShapeKind.plane,
        size_m=[0, 0, 0],
        material=scene.add_material(_core.Material(layers=layers)),
        world_from_shape=Transform(),
    )
    scene.set_light(to_sun=[0, 0, 1], sun=0.7, sky=0.3, background=0)
    return scene


def test_the_ground_does_not_repeat():
    """A patch is found once in a picture that is larger than the sample it was made of."""
    scene = rough_ground(side=256, texel_m=0.002)  # a period of 0.512 m
    camera = Camera(width_px=640, height_px=480, fx_px=400, fy_px=400, cx_px=319.5, cy_px=239.5)
    above = np.diag([1.0, -1.0, -1.0, 1.0])
    above[2, 3] = 0.8  # 1.28 m across, 2 mm a pixel
    seen = _core.render(scene, _core.CameraRays(camera), Transform.from_matrix(above))["radiance"]
    for y, x in ((230, 310), (100, 100), (300, 500), (400, 50), (50, 400)):
        patch = seen[y : y + 21, x : x + 21]
        scores = cv2.matchTemplate(seen, patch, cv2.TM_CCOEFF_NORMED)
        assert scores[y, x] > 0.999
        scores[y - 5 : y + 6, x - 5 : x + 6] = 0
        # Noise without any sample behind it reaches 0.5 over such a picture.
        assert scores.max() < 0.65


def test_bad_scenes_are_refused():
    scene = _core.Scene()
    with pytest.raises(ValueError, match="power of two"):
        scene.add_exemplar(np.zeros((10, 10), np.float32))
    with pytest.raises(ValueError, match="material 0: there are 0"):
        scene.add_shape(
            kind=_core.ShapeKind.sphere, size_m=[1, 1, 1], material=0, world_from_shape=Transform()
        )
    with pytest.raises(ValueError, match="no length"):
        scene.set_light(to_sun=[0, 0, 0], sun=1, sky=0, background=0)
    camera = _core.CameraRays(make_camera("none"))
    with pytest.raises(ValueError, match="edge_samples = 5"):
        _core.render(scene, camera, Transform(), edge_samples=5)
    with pytest.raises(ValueError, match="channels = 2"):
        _core.render(scene, camera, Transform(), channels=2)
    row = _core.RowExposure(Transform())
    moved = _core.ShapeMotion(0, begin=Transform(), end=Transform())
    of_none = _core.ShutterPoses(first=row, moving=[moved])
    with pytest.raises(ValueError, match="shape = 0: the scene has 0"):
        _core.render(scene, camera, of_none)
    too_long = _core.ShutterPoses(first=row, exposed_share=1.5)
    with pytest.raises(ValueError, match=r"exposed_share = 1.5"):
        _core.render(scene, camera, too_long)
