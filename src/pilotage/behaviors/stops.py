# SPDX-License-Identifier: Apache-2.0
"""The stops of a recorded walk: what was seen from each place where a robot stood and looked."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from pilotage import Transform
from pilotage.behaviors.sweep import View
from pilotage.calibration.nao_head import HeadAngles
from pilotage.errors import InputError
from pilotage.recordings.frames import BadFrame
from pilotage.recordings.single import PictureRecording, SinglePicture

YAW, PITCH = "HeadYaw", "HeadPitch"
SAME_M = 1e-3  # a pose told twice that differs by less is one place
SAME_TURN = 1e-3  # of any element of the rotation
FEWEST = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class Stop:
    """Views from one place in order of time: of the first posture, and `others`, say of a crouch.

    `floor_z_m` is the floor's height in the frame `stop`, None where the recording does not tell.
    `bad` are pictures that could not be read.
    """

    number: int
    views: list[View]
    others: list[View]
    floor_z_m: float | None
    bad: list[str]


def read_stop(recording: PictureRecording, number: int) -> Stop:
    """Return the stop of that number, from 0: pictures of a robot that stood, from one place.

    InputError where there is no such stop, or the recording tells
    neither of the head nor of where its cameras are.
    """
    count = 0
    for run, bad in standing_runs(recording.pictures()):
        if len(run) < FEWEST:
            continue
        if count == number:
            return _stop(recording, number, run, bad)
        count += 1
    if not count:
        raise InputError(
            f"{recording.path}: the robot never stood and took {FEWEST} pictures from one place;"
            " record stops (pilotage simulate --robot nao)"
        )
    raise InputError(
        f"{recording.path}: has no stop {number}; choose one from 0 to {count - 1} with --stop"
    )


def standing_runs(
    pictures: Iterable[SinglePicture | BadFrame],
) -> Iterator[tuple[list[SinglePicture], list[str]]]:
    """Yield runs of pictures taken standing from one place, and what could not be read there."""
    run: list[SinglePicture] = []
    bad: list[str] = []
    for picture in pictures:
        if isinstance(picture, BadFrame):
            bad.append(picture.reason)
            continue
        if run and (picture.is_moving or not _is_same_place(run[0], picture)):
            yield run, bad
            run, bad = [], []
        if not picture.is_moving:
            run.append(picture)
    if run:
        yield run, bad


def _is_same_place(a: SinglePicture, b: SinglePicture) -> bool:
    return _is_same(a.odom_from_robot, b.odom_from_robot)


def _is_same(a: Transform | None, b: Transform | None) -> bool:
    if a is None or b is None:
        return True
    apart = a.inverse().matrix() @ b.matrix() - np.eye(4)
    return bool(np.linalg.norm(apart[:3, 3]) < SAME_M and np.abs(apart[:3, :3]).max() < SAME_TURN)


def _robot_from_torso(picture: SinglePicture) -> Transform | None:
    if picture.robot_from_camera is None or picture.torso_from_camera is None:
        return None
    return picture.robot_from_camera @ picture.torso_from_camera.inverse()


def _stop(
    recording: PictureRecording, number: int, run: list[SinglePicture], bad: list[str]
) -> Stop:
    first = _robot_from_torso(run[0])
    views: list[View] = []
    others: list[View] = []
    for picture in run:
        robot_from_torso = _robot_from_torso(picture)
        is_first = _is_same(first, robot_from_torso)
        raised = Transform()
        if not is_first and first is not None and robot_from_torso is not None:
            raised = first.inverse() @ robot_from_torso
        (views if is_first else others).append(_view(recording, picture, raised))
    floor_z_m = None if first is None else float(first.inverse().translation_m[2])
    return Stop(number=number, views=views, others=others, floor_z_m=floor_z_m, bad=list(bad))


def _view(recording: PictureRecording, picture: SinglePicture, stop_from_torso: Transform) -> View:
    joints = picture.joints_rad
    if YAW not in joints or PITCH not in joints or picture.torso_from_camera is None:
        raise InputError(
            f"{recording.path}: picture {picture.index} of camera {picture.camera} has no"
            f" {YAW}, {PITCH} or frame torso within 0.1 s; record joints and /tf as well, or give"
            " a folder of pictures"
        )
    head = HeadAngles(joints[YAW], joints[PITCH])
    # Not -0.0, which would read as another direction than 0.0.
    yaw_deg, pitch_deg = (round(math.degrees(angle), 1) + 0.0 for angle in head)
    return View(
        name=f"{picture.index} {picture.camera} {yaw_deg:+.1f} {pitch_deg:+.1f}",
        grey=picture.picture, lens=recording.cameras[picture.camera], camera=picture.camera,
        head=head, torso_from_camera=picture.torso_from_camera, stop_from_torso=stop_from_torso,
    )  # fmt: skip
