# SPDX-License-Identifier: Apache-2.0
"""A sweep of the head with cameras that move: the neck's kinematics, refined by what is seen.

A camera sits centimetres off the neck's axes, so it moves while the head turns, and encoders err.
What two pictures share tells the true angles and how far things are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pilotage import Transform, _core
from pilotage.behaviors.sweep import Array, Shared, View
from pilotage.calibration.nao_head import HEAD_Z_M, JOINT_SIGMA_RAD, neck_axes

# How well the cameras' seats on the head are known.
SEAT_SIGMA_M, SEAT_SIGMA_RAD = 1e-4, 1e-4
# Where the legs' joints tell the torso to be after a crouch.
TORSO_SIGMA_M, TORSO_SIGMA_RAD = 0.005, 0.01
SAME_RAD = 0.01  # angles told that differ by less (and metres of a torso) are of one look
NEAREST_M, FURTHEST_M = 0.3, 100.0
OUTLIER_SIGMA = 3.5
FEWEST = 12  # points, for the angles to be refined
ROUNDS = 3
ITERATIONS = 30


@dataclass(frozen=True, kw_only=True, eq=False)
class Refined:
    """Where the cameras of a sweep were, and points that two pictures show.

    `stop_from_camera` is by view. Points are (N, 3) in the frame `stop` (x forward, y left, z
    up), metres; `inverse_sigma` (N,) is the standard error of one over their distance, 1/m.
    `shared` and `row` (N,) say of which match each is. `rms_px` is of the residuals; `turned_rad`
    (views, 2) what was added to yaw and pitch as told. Where too little was shared, all is as told
    and `reason` says so.
    """

    stop_from_camera: list[Transform]
    points_in_stop: Array
    inverse_sigma: Array
    shared: NDArray[np.intp]
    row: NDArray[np.intp]
    rms_px: float
    turned_rad: Array
    reason: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Matches:
    """All matches of a sweep: views a and b, unit rays in both, standard error of either (rad)."""

    a: NDArray[np.intp]
    b: NDArray[np.intp]
    rays_a: Array
    rays_b: Array
    sigma: Array
    shared: NDArray[np.intp]
    row: NDArray[np.intp]

    def kept(self, which: NDArray[np.bool_]) -> _Matches:
        return _Matches(**{name: column[which] for name, column in vars(self).items()})


def refine_sweep(views: Sequence[View], shared: Sequence[Shared]) -> Refined:
    """Return the cameras' poses and the points that fit best what every two pictures share.

    Views must have their head's angles and `torso_from_camera`. The angles told are measurements
    with `JOINT_SIGMA_RAD` among the others; both cameras of one look turn together. Pictures taken
    crouching see everything from another height, so they tell distances where no neighbour does.
    """
    told = [_pose_of(view) for view in views]
    matches = _collect(views, shared)
    poses, points = told, np.empty((0, 3))
    rms = math.nan
    for number in range(ROUNDS):
        near = _are_plausible(poses, matches, loose=number == 0)
        matches = matches.kept(near)
        if len(matches.a) < FEWEST:
            break
        poses, points, residual, rms = _adjust(views, poses, matches)
        kept = residual < OUTLIER_SIGMA
        matches, points = matches.kept(kept), points[kept]
    if len(matches.a) < FEWEST:
        matches, points = matches.kept(np.zeros(len(matches.a), bool)), np.empty((0, 3))
        poses, rms = told, math.nan
    return Refined(
        stop_from_camera=poses,
        points_in_stop=points,
        inverse_sigma=_inverse_sigma(poses, matches, points),
        shared=matches.shared, row=matches.row, rms_px=rms,
        turned_rad=np.array([_turned(*pair) for pair in zip(told, poses, strict=True)]),
        reason="" if len(points) else f"fewer than {FEWEST} points are shared by pictures",
    )  # fmt: skip


def _pose_of(view: View) -> Transform:
    told = view.stop_from_camera
    if told is None or view.head is None:
        raise ValueError(f"{view.name}: the robot told no head angles")
    return told


def _collect(views: Sequence[View], shared: Sequence[Shared]) -> _Matches:
    def rays(number: int, pixels: Array) -> Array:
        return np.asarray(views[number].lens.unproject(np.ascontiguousarray(pixels)))

    def joined(parts: list[Array], width: tuple[int, ...] = ()) -> Array:
        return np.concatenate([np.empty((0, *width)), *parts])

    def each(values: list[int]) -> NDArray[np.intp]:
        return np.repeat(np.array(values, np.intp), [len(s.rows_a) for s in shared])

    matches = _Matches(
        a=each([s.a for s in shared]), b=each([s.b for s in shared]),
        rays_a=joined([rays(s.a, s.pixels_a) for s in shared], (3,)),
        rays_b=joined([rays(s.b, s.pixels_b) for s in shared], (3,)),
        sigma=joined([s.sigma_px / views[s.b].lens.fx_px for s in shared]),
        shared=each(list(range(len(shared)))),
        row=np.concatenate([np.arange(0), *(np.arange(len(s.rows_a)) for s in shared)]),
    )  # fmt: skip
    is_known = np.isfinite(np.hstack([matches.rays_a, matches.rays_b])).all(axis=1)
    return matches.kept(np.asarray(is_known))


def _in_stop(
    poses: Sequence[Transform], numbers: NDArray[np.intp], rays: Array
) -> tuple[Array, Array]:
    """Return the centres (N, 3) and directions (N, 3) of rays of views."""
    turns = np.array([pose.matrix()[:3, :3] for pose in poses])
    centres = np.array([pose.translation_m for pose in poses])
    return centres[numbers], np.einsum("nij,nj->ni", turns[numbers], rays)


def _closest(poses: Sequence[Transform], matches: _Matches) -> tuple[Array, Array]:
    """Return one over the distance along the rays of a (N,), and how far rays of b miss (rad).

    To first order in the parallax, which is small and without a singularity at infinity.
    """
    centre_a, ahead_a = _in_stop(poses, matches.a, matches.rays_a)
    centre_b, ahead_b = _in_stop(poses, matches.b, matches.rays_b)
    # A point at inverse distance w on the ray of a is seen from b along a + w (centre_a - centre_b)
    # so w is what turns that into b: least squares in the plane normal to b.
    moved = centre_a - centre_b
    across = moved - ahead_b * np.sum(moved * ahead_b, axis=1, keepdims=True)
    wanted = -(ahead_a - ahead_b * np.sum(ahead_a * ahead_b, axis=1, keepdims=True))
    inverse = np.sum(across * wanted, axis=1) / np.maximum(np.sum(across**2, axis=1), 1e-12)
    return inverse, np.linalg.norm(wanted - across * inverse[:, None], axis=1)


def _are_plausible(
    poses: Sequence[Transform], matches: _Matches, *, loose: bool
) -> NDArray[np.bool_]:
    """Tell of which matches the rays meet ahead of the robot, not too near.

    Before angles are refined they let rays miss each other, and seem to meet beyond infinity.
    """
    inverse, miss = _closest(poses, matches)
    centre_a, _ = _in_stop(poses, matches.a, matches.rays_a)
    centre_b, _ = _in_stop(poses, matches.b, matches.rays_b)
    base_m = np.maximum(np.linalg.norm(centre_a - centre_b, axis=1), 1e-6)
    slack = OUTLIER_SIGMA * (matches.sigma + (2 * JOINT_SIGMA_RAD if loose else 0.0))
    beyond = slack / base_m
    return np.asarray((miss < slack) & (inverse < 1 / NEAREST_M + beyond) & (inverse > -beyond))


def _adjust(
    views: Sequence[View], poses: Sequence[Transform], matches: _Matches
) -> tuple[list[Transform], Array, Array, float]:
    """Return poses, points, the larger residual of each match in sigmas, and the rms in pixels."""
    inverse, _ = _closest(poses, matches)
    distance_m = 1 / np.clip(inverse, 1 / FURTHEST_M, 1 / NEAREST_M)
    centre, ahead = _in_stop(poses, matches.a, matches.rays_a)
    count, focal_px = len(matches.a), views[0].lens.fx_px
    pixels = np.stack([_ideal(matches.rays_a, focal_px), _ideal(matches.rays_b, focal_px)], axis=1)
    # A pixel off the axis of an ideal camera stands for less of an angle.
    stretch = np.stack([1 / matches.rays_a[:, 2] ** 2, 1 / matches.rays_b[:, 2] ** 2], axis=1)
    sigma = focal_px * matches.sigma[:, None] * stretch / math.sqrt(2)
    measured = np.full((2 * count, 5), np.nan, np.float32)
    measured[:, :2] = pixels.reshape(-1, 2)
    measured[:, 3] = measured[:, 4] = sigma.ravel()
    problem = _core.BundleProblem(
        # One ideal camera for all: rays carry no lens any more.
        stereo=_core.RectifiedStereo(
            width_px=views[0].lens.width_px, height_px=views[0].lens.height_px, focal_px=focal_px,
            cx_px=0.0, cy_px=0.0, cx_right_px=0.0, baseline_m=1.0,
        ),
        world_from_left=list(poses),
        pose_is_fixed=np.zeros(len(poses), bool),
        points_in_world=centre + ahead * distance_m[:, None],
        frames=np.stack([matches.a, matches.b], axis=1).ravel().astype(np.int32),
        points=np.repeat(np.arange(count, dtype=np.int32), 2),
        measured_px=measured,
    )  # fmt: skip
    problem.prior = _prior(views)
    options = _core.BundleOptions()
    options.loss, options.max_iterations = _core.RobustLoss.cauchy, ITERATIONS
    result = _core.adjust_bundle(problem=problem, options=options)
    residual = result.normalised_residuals.reshape(-1, 2)
    fits = (residual < OUTLIER_SIGMA).all(axis=1)
    rms_px = float(np.sqrt(np.mean((residual * sigma / stretch)[fits] ** 2))) if fits.any() else 0.0
    return problem.world_from_left, problem.points_in_world, residual.max(axis=1), rms_px


def _ideal(rays: Array, focal_px: float) -> Array:
    return np.asarray(focal_px * rays[:, :2] / rays[:, 2:])


def _prior(views: Sequence[View]) -> _core.PosePrior:
    """Return what joints and seats tell of the poses: those of one look turn together, and those
    of another posture than the first may all be off."""
    told = [_pose_of(view) for view in views]
    posture = _groups([view.stop_from_torso.matrix()[:3].ravel() for view in views])
    told_heads = [
        np.array([*(v.head or ()), 10.0 * p]) for v, p in zip(views, posture, strict=True)
    ]
    look = _groups(told_heads)
    slopes = np.zeros((6 * len(views), 2 * (1 + max(look)) + 6 * max(posture)))
    for number, view in enumerate(views):
        rows = slice(6 * number, 6 * number + 6)
        slopes[rows, 2 * look[number] : 2 * look[number] + 2] = JOINT_SIGMA_RAD * _neck_turns(view)
        if posture[number]:
            first = 2 * (1 + max(look)) + 6 * (posture[number] - 1)
            slopes[rows, first : first + 6] = _torso_moves(view)
    seat = np.array([*3 * [SEAT_SIGMA_M**2], *3 * [SEAT_SIGMA_RAD**2]])
    covariance = slopes @ slopes.T + np.diag(np.tile(seat, len(views)))
    return _core.PosePrior(
        world_from_left=told,
        information=np.asarray(np.linalg.inv(covariance), np.float64),
        gradient=np.zeros(6 * len(views)),
    )


def _neck_turns(view: View) -> Array:
    """Return the motions (6, 2) of a camera, translation over rotation, by yaw and pitch."""
    yaw_rad = 0.0 if view.head is None else view.head.yaw_rad
    axes = neck_axes(yaw_rad) @ view.stop_from_torso.matrix()[:3, :3].T
    neck = view.stop_from_torso @ np.array([0.0, 0.0, HEAD_Z_M])
    # A turn about an axis through the neck moves the origin.
    return np.vstack([np.cross(neck, axes).T, axes.T])


def _torso_moves(view: View) -> Array:
    """Return the motions (6, 6) of a torso that is not quite where the legs tell it to be."""
    origin = np.asarray(view.stop_from_torso.translation_m)
    moves = np.zeros((6, 6))
    moves[:3, :3] = TORSO_SIGMA_M * np.eye(3)
    moves[:3, 3:] = TORSO_SIGMA_RAD * np.cross(origin, np.eye(3)).T
    moves[3:, 3:] = TORSO_SIGMA_RAD * np.eye(3)
    return moves


def _groups(values: Sequence[Array]) -> list[int]:
    """Return a number for each value, the same for those told alike."""
    found: list[Array] = []
    groups = []
    for value in values:
        same = [i for i, other in enumerate(found) if np.abs(value - other).max() < SAME_RAD]
        if not same:
            found.append(value)
        groups.append(same[0] if same else len(found) - 1)
    return groups


def _turned(told: Transform, found: Transform) -> list[float]:
    """Return by how much a camera turned to the left and downward from where it was told to be."""
    change = (found @ told.inverse()).matrix()
    left = told.matrix()[:3, 0] * -1.0
    turn = 0.5 * np.array([change[2, 1] - change[1, 2], change[0, 2] - change[2, 0],
                           change[1, 0] - change[0, 1]])  # fmt: skip
    return [float(turn[2]), float(turn @ left)]


def _inverse_sigma(poses: Sequence[Transform], matches: _Matches, points: Array) -> Array:
    """Return the standard errors (N,) of inverse distances that the matches' own errors leave."""
    centre_a, _ = _in_stop(poses, matches.a, matches.rays_a)
    centre_b, ahead_b = _in_stop(poses, matches.b, matches.rays_b)
    moved = centre_a - centre_b
    across = np.linalg.norm(np.cross(moved, ahead_b), axis=1)
    return np.asarray(matches.sigma / np.maximum(across, 1e-9))
