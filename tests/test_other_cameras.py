# SPDX-License-Identifier: Apache-2.0
"""Pictures that other cameras took, and mirrors, among those of a walk: never a wrong model."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from rendering import PinholeCamera, Renderer, World, room
from test_reconstruct import HEIGHT, WIDTH, pose

from pilotage import Camera, PictureFate
from pilotage.behaviors.reconstruct import Reconstructed, solve
from pilotage.evaluation.camera_poses import PoseErrors, pose_errors

FOCAL = 420.0
CENTRE = np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2])
CAMERA = Camera(
    width_px=WIDTH, height_px=HEIGHT, fx_px=FOCAL, fy_px=FOCAL, cx_px=CENTRE[0], cy_px=CENTRE[1]
)
RIGHT_M = 0.002  # what the poses of a walk of 2 m may be off by
# A wall of the room, x = 5.5 m, part of which is a mirror: y and z of its edges, metres.
WALL_M = 5.5
MIRROR_M = (-1.6, 1.4, 0.5, 2.4)


def photograph(world: World, poses: np.ndarray, *, seed: int = 3) -> list[np.ndarray]:
    """Return noisy (HEIGHT, WIDTH) uint8 pictures of a world."""
    rng = np.random.default_rng(seed)
    camera = PinholeCamera(WIDTH, HEIGHT, FOCAL, FOCAL, *CENTRE)
    renderer = Renderer(world, camera, seed)
    pictures = [renderer.render(p) + rng.normal(0, 1.5, (HEIGHT, WIDTH)) for p in poses]
    return [np.clip(picture, 0, 255).astype(np.uint8) for picture in pictures]


def enlarged(picture: np.ndarray, times: float) -> np.ndarray:
    """Return the picture as a lens of `times` the focal length sees it."""
    warp = np.column_stack([times * np.eye(2), (1 - times) * CENTRE])
    return cv2.warpAffine(picture, warp, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC)


@pytest.fixture(scope="module")
def poses() -> np.ndarray:
    """Ten places on a curve of 2 m, (10, 4, 4)."""
    steps = np.linspace(0, 1, 10)
    return np.array([pose(0.3 * np.sin(3 * t), 1.0 - 2 * t, 12 * t - 6) for t in steps])


@pytest.fixture(scope="module")
def pictures(poses: np.ndarray) -> list[np.ndarray]:
    """What a camera sees there."""
    return photograph(room(3.0, np.random.default_rng(3)), poses)


def model_of(pictures: list[np.ndarray]) -> Reconstructed:
    """Reconstruct pictures called 0, 1, ..."""
    return solve(pictures, [str(i) for i in range(len(pictures))], camera=CAMERA)


def errors_of(found: Reconstructed, poses: np.ndarray) -> PoseErrors:
    """Return the errors of the pictures that have a pose."""
    posed = [int(name) for name in found.model.names]
    errors = pose_errors(estimate=found.model.world_from_camera(), truth=poses[posed])
    assert errors is not None
    return errors


@pytest.mark.parametrize(
    ("others", "times"),
    [((4,), 1.5), ((1, 4, 7), 1.2), ((2, 3, 8), 0.8), ((5, 6, 7, 8, 9), 1.5), ((1, 3, 5, 7), 1.5)],
)
def test_pictures_of_another_focal_length_are_taken_out(pictures, poses, others, times):
    mixed = [enlarged(p, times) if i in others else p for i, p in enumerate(pictures)]
    found = model_of(mixed)
    posed = {int(name) for name in found.model.names}
    assert len(posed) >= 3
    # Where both kinds are equally many, either may be the model: nothing tells which is right.
    if len(others) < 4:
        assert not posed & set(others)
        assert errors_of(found, poses).ate_rmse_m < RIGHT_M
    assert posed <= set(others) or not posed & set(others)
    left = {fate for i, fate in enumerate(found.fates) if i not in posed}
    assert left == {PictureFate.other_camera}


def test_pictures_of_one_camera_all_stay(pictures, poses):
    found = model_of(pictures)
    assert found.is_whole
    assert errors_of(found, poses).ate_rmse_m < RIGHT_M


@pytest.mark.parametrize("mirrored", [(4,), (2, 5, 6), (5, 6, 7, 8, 9)])
def test_pictures_seen_left_to_right_get_no_pose_among_others(pictures, poses, mirrored):
    mixed = [np.fliplr(p).copy() if i in mirrored else p for i, p in enumerate(pictures)]
    found = model_of(mixed)
    posed = {int(name) for name in found.model.names}
    # Mirrored ones may make a model of their own: that of the mirrored world.
    assert posed <= set(mirrored) or not posed & set(mirrored)
    assert not found.is_whole
    if not posed & set(mirrored):
        assert errors_of(found, poses).ate_rmse_m < RIGHT_M


def behind_the_mirror(world: World) -> World:
    """Return what is before the plane x = WALL_M as it is seen in a mirror there."""
    flip = np.array([-1.0, 1.0, 1.0])
    seen = World()
    for corner, edges, lengths in zip(world.corners, world.edges, world.lengths, strict=True):
        sides = [edge * length for edge, length in zip(edges, lengths, strict=True)]
        at_wall = all(abs(side[0]) < 1e-9 for side in sides) and abs(corner[0] - WALL_M) < 1e-9
        away = 1e3 * np.array([0.0, 0.0, 1.0]) if at_wall else np.zeros(3)
        seen.add(flip * corner + (2 * WALL_M, 0, 0) + away, *(flip * side for side in sides))
    return seen


def test_a_mirror_on_the_wall_moves_no_camera():
    world = room(3.0, np.random.default_rng(3))
    steps = np.linspace(0, 1, 8)
    poses = np.array([pose(1.0 + 0.2 * np.sin(3 * t), 0.8 - 1.6 * t, 5 - 10 * t) for t in steps])
    low_y, high_y, low_z, high_z = MIRROR_M
    corners = [(low_y, low_z), (low_y, high_z), (high_y, high_z), (high_y, low_z)]
    edge = np.array([(WALL_M, y, z) for y, z in corners])
    reflections = photograph(behind_the_mirror(world), poses)
    seen = zip(photograph(world, poses), reflections, poses, strict=True)
    pictures = []
    for direct, reflected, world_from_camera in seen:
        in_camera = (edge - world_from_camera[:3, 3]) @ world_from_camera[:3, :3]
        outline = FOCAL * in_camera[:, :2] / in_camera[:, 2:] + CENTRE
        glass = np.zeros((HEIGHT, WIDTH), np.uint8)
        cv2.fillConvexPoly(glass, np.rint(outline).astype(np.int32), 1)
        assert 0.1 < glass.mean() < 0.9
        pictures.append(np.where(glass == 1, reflected, direct).astype(np.uint8))
    found = model_of(pictures)
    assert len(found.model.names) >= 3
    assert errors_of(found, poses).ate_rmse_m < RIGHT_M
